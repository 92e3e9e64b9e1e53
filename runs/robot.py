"""robot.yaml: the wheels, the camera, their clocks, and where the robot starts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from localization.odometry import WheelGeometry
from maps.documents import checked, read_yaml
from maps.outcomes import PoseBelief
from maps.poses import Pose2
from vision.camera import Camera, CameraModel, CameraMount

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Deviation = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=2**16)]
#: A mount beyond a quarter turn is a slip of the pen, mostly degrees.
Tilt = Annotated[float, Field(ge=-math.pi / 2, le=math.pi / 2)]
Angle = Annotated[float, Field(ge=-math.pi, le=math.pi)]

DISTORTION_KEYS = {
    CameraModel.PINHOLE_RADTAN: ("distortion_k1_k2_p1_p2_k3", 5),
    CameraModel.FISHEYE: ("distortion_k1_k2_k3_k4", 4),
}


@dataclass(frozen=True, slots=True)
class Start:
    """The pose at the session's first event; `phi_rad` infinitely uncertain where it is not known."""

    pose: Pose2
    std_x_m: float
    std_y_m: float
    std_phi_rad: float

    def at(self, stamp_ns: int) -> PoseBelief:
        """Return the belief at that stamp."""
        return PoseBelief(stamp_ns, self.pose, np.diag([self.std_x_m, self.std_y_m, self.std_phi_rad]) ** 2)


@dataclass(frozen=True, slots=True)
class Robot:
    """What is known of the robot: `wheels` None where odometry is a twist, `camera` None without one.

    `time_offset_ns` added to an image's stamp gives odometry's clock. `twist_scales`: what forward speeds and turn
    rates are multiplied with, where odometry is a twist.
    """

    path: Path
    wheels: WheelGeometry | None
    camera: Camera | None
    time_offset_ns: int
    start: Start | None
    twist_scales: tuple[float, float] = (1.0, 1.0)


class _Wheels(BaseModel):
    radius_m: Positive
    baseline_m: Positive
    left_radius_m: Positive | None = None
    right_radius_m: Positive | None = None
    #: Of either radius where it has none of its own.
    std_radius_m: Deviation | None = None
    std_left_radius_m: Deviation | None = None
    std_right_radius_m: Deviation | None = None
    std_baseline_m: Deviation | None = None


class _Mount(BaseModel):
    x_m: Finite
    y_m: Finite
    height_m: Positive
    pitch_down_rad: Tilt
    yaw_rad: Angle
    roll_rad: Angle
    std_height_m: Deviation = CameraMount().std_height_m
    std_pitch_down_rad: Deviation = CameraMount().std_pitch_down_rad
    std_yaw_rad: Deviation = CameraMount().std_yaw_rad
    std_roll_rad: Deviation = CameraMount().std_roll_rad


class _Camera(BaseModel):
    model: CameraModel
    width: Pixels
    height: Pixels
    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite
    std_fx: Deviation | None = None
    std_fy: Deviation | None = None
    std_cx: Deviation | None = None
    std_cy: Deviation | None = None
    distortion_k1_k2_p1_p2_k3: list[Finite] | None = None
    distortion_k1_k2_k3_k4: list[Finite] | None = None
    mount: _Mount

    @property
    def distortion(self) -> list[float]:
        key, _ = DISTORTION_KEYS[self.model]
        coefficients: list[float] = getattr(self, key) or []
        return coefficients

    @model_validator(mode="after")
    def _coefficients_fit_model(self) -> Self:
        key, count = DISTORTION_KEYS[self.model]
        if len(self.distortion) != count:
            raise ValueError(f"{key} needs {count} numbers for {self.model}")
        return self


class _Start(BaseModel):
    x_m: Finite
    y_m: Finite
    phi_rad: Finite | None = None
    std_x_m: Positive
    std_y_m: Positive
    std_phi_rad: Positive | None = None

    @model_validator(mode="after")
    def _heading_has_deviation(self) -> Self:
        if self.phi_rad is not None and self.std_phi_rad is None:
            raise ValueError("std_phi_rad is missing beside phi_rad")
        return self


class _Twist(BaseModel):
    forward_scale: Positive = 1.0
    turn_scale: Positive = 1.0


class _Robot(BaseModel):
    wheels: _Wheels | None = None
    twist: _Twist | None = None
    camera: _Camera | None = None
    time_offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.0
    initial_pose: _Start | None = None


def read_robot(path: Path) -> Robot:
    """Read robot.yaml; keys it does not know are left alone.

    InputError names the key that is missing, of another kind, not finite or out of range.
    """
    document = checked(_Robot, read_yaml(path), path)
    twist = document.twist or _Twist()
    return Robot(
        path=path,
        wheels=_wheels(document.wheels) if document.wheels else None,
        camera=_camera(document.camera) if document.camera else None,
        time_offset_ns=round(document.time_offset_s * 1e9),
        start=_start(document.initial_pose) if document.initial_pose else None,
        twist_scales=(twist.forward_scale, twist.turn_scale),
    )


def _wheels(document: _Wheels) -> WheelGeometry:
    return WheelGeometry(
        document.left_radius_m or document.radius_m,
        document.right_radius_m or document.radius_m,
        document.baseline_m,
        _first(document.std_left_radius_m, document.std_radius_m),
        _first(document.std_right_radius_m, document.std_radius_m),
        document.std_baseline_m,
    )


def _first(own: float | None, common: float | None) -> float | None:
    return common if own is None else own


def _camera(document: _Camera) -> Camera:
    values: dict[str, Any] = document.model_dump(include={"model", "width", "height", "fx", "fy", "cx", "cy"})
    mount = CameraMount(**document.mount.model_dump())
    return Camera(
        **values,
        distortion=np.array(document.distortion),
        mount=mount,
        std_focal=max((document.std_fx or 0.0) / document.fx, (document.std_fy or 0.0) / document.fy),
        std_centre_px=max(document.std_cx or 0.0, document.std_cy or 0.0),
    )


def _start(document: _Start) -> Start:
    if document.phi_rad is None or document.std_phi_rad is None:
        return Start(Pose2(document.x_m, document.y_m, 0.0), document.std_x_m, document.std_y_m, math.inf)
    pose = Pose2(document.x_m, document.y_m, document.phi_rad)
    return Start(pose, document.std_x_m, document.std_y_m, document.std_phi_rad)
