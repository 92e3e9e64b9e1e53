"""The robot's parameters that a drive can show: their names, what is known of them, and their place in robot.yaml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from pydantic import BaseModel, Field

from localization.drivenmotion import TWIST_PARAMETERS, WHEEL_PARAMETERS
from localization.odometry import OdometryNoise
from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.poses import Array
from runs.bags.opening import is_bag
from runs.robot import Robot
from runs.robotfile import with_keys
from runs.robotproblem import Prior
from runs.session import Session
from vision.seenlines import MOUNT_PARAMETERS, mount_values, with_mount

_MOUNT = len(MOUNT_PARAMETERS)
#: Finer than anything is known, short enough to read.
_DECIMALS = {"m": 6, "rad": 6, "s": 5, "rad/s": 6, "": 6}

Deviation = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Doubts:
    """Standard deviations of the parameters before a calibration, at the least: who calibrates doubts the file.

    A file's own `std_...` counts where it is larger. `lever_m`, `height_m`: with a tape; `tilt_rad`, `yaw_rad`: by
    eye, about one degree; `radius_share`, `baseline_share`: of the value, tyres carry a load and contact is wide;
    `offset_s`: between clocks, or of a trigger; the rest of drivers of twists.
    """

    lever_m: float = 0.02
    height_m: float = 0.02
    tilt_rad: float = 0.02
    yaw_rad: float = 0.02
    radius_share: float = 0.01
    baseline_share: float = 0.02
    offset_s: float = 0.05
    forward_share: float = 0.1
    turn_share: float = 0.1
    bias_radps: float = 2e-3


class _MountStd(BaseModel):
    std_x_m: Deviation = 0.0
    std_y_m: Deviation = 0.0


class _CameraStd(BaseModel):
    mount: _MountStd = _MountStd()


class _Stds(BaseModel):
    """Deviations that nothing but a calibration reads."""

    camera: _CameraStd = _CameraStd()
    std_time_offset_s: Deviation = 0.0


def names_of(by_wheels: bool) -> tuple[str, ...]:
    """Return the ten parameters' names, the mount's first; in the order of all arrays here."""
    return (*MOUNT_PARAMETERS, *(WHEEL_PARAMETERS if by_wheels else TWIST_PARAMETERS))


def unit_of(name: str) -> str:
    """Return a parameter's SI unit, empty for a factor."""
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")


_ENDINGS = {"_m": "m", "_radps": "rad/s", "_rad": "rad", "_s": "s"}


def prior_of(robot: Robot, by_wheels: bool, doubts: Doubts, noise: OdometryNoise) -> tuple[Prior, Array]:
    """Return what to begin with, and the deviations (10,) that the file states, NaN where it says nothing.

    InputError where a deviation in the file is none.
    """
    assert robot.camera is not None
    mount = robot.camera.mount
    # A bag says nothing of how well it knows.
    own = checked(_Stds, {} if is_bag(robot.path) else read_yaml(robot.path), robot.path)
    stated = [own.camera.mount.std_x_m, own.camera.mount.std_y_m, mount.std_height_m]
    stated += [mount.std_pitch_down_rad, mount.std_roll_rad, mount.std_yaw_rad]
    least = [
        doubts.lever_m,
        doubts.lever_m,
        doubts.height_m,
        doubts.tilt_rad,
        doubts.tilt_rad,
        doubts.yaw_rad,
    ]
    if by_wheels:
        assert robot.wheels is not None
        wheels = robot.wheels
        driven = [wheels.left_radius_m, wheels.right_radius_m, wheels.baseline_m]
        stated += [
            wheels.std_left_radius_m or 0.0,
            wheels.std_right_radius_m or 0.0,
            wheels.std_baseline_m or 0.0,
        ]
        least += [
            doubts.radius_share * driven[0],
            doubts.radius_share * driven[1],
            doubts.baseline_share * driven[2],
        ]
    else:
        driven = [*robot.twist_scales, 0.0]
        stated += [0.0, 0.0, noise.twist_bias_radps]
        least += [doubts.forward_share, doubts.turn_share, doubts.bias_radps]
    values = np.array([*mount_values(mount), *driven, robot.time_offset_ns * 1e-9])
    told = np.array([*stated, own.std_time_offset_s])
    return Prior(values, np.maximum(told, [*least, doubts.offset_s])), np.where(told > 0.0, told, np.nan)


def with_robot(session: Session, values: Array, std: Array) -> Session:
    """Return the session of a robot with these parameters (10,), and deviations (6,) of its mount."""
    robot = session.robot
    assert robot.camera is not None
    camera = with_mount(robot.camera, values[:_MOUNT])
    height, pitch, roll, yaw = std[2:].tolist()
    doubts = {"std_height_m": height, "std_pitch_down_rad": pitch, "std_roll_rad": roll, "std_yaw_rad": yaw}
    camera = replace(camera, mount=replace(camera.mount, **doubts))
    first, second, third, offset_s = values[_MOUNT:].tolist()
    later_ns = round(offset_s * 1e9) - robot.time_offset_ns
    robot = replace(robot, camera=camera, time_offset_ns=robot.time_offset_ns + later_ns)
    odometry = session.odometry
    if odometry.wheels is not None:
        wheels = replace(odometry.wheels, left_radius_m=first, right_radius_m=second, baseline_m=third)
        robot, odometry = replace(robot, wheels=wheels), replace(odometry, wheels=wheels)
    else:
        scales = np.array([first, second])
        odometry = replace(odometry, values=odometry.values * (scales / robot.twist_scales))
        robot = replace(robot, twist_scales=(first, second))
    frames = tuple(
        replace(
            frame,
            stamp_ns=frame.stamp_ns + later_ns,
            arrival_ns=max(frame.arrival_ns, frame.stamp_ns + later_ns),
        )
        for frame in session.frames
    )
    looks = [frame.stamp_ns for frame in frames] + [fix.stamp_ns for fix in session.fixes]
    start_ns = min(int(odometry.stamps_ns[0]), *looks)
    initial = None if session.initial is None else replace(session.initial, stamp_ns=start_ns)
    return replace(session, robot=robot, odometry=odometry, frames=frames, start_ns=start_ns, initial=initial)


def with_parameters(text: str, source: Path, values: Mapping[str, float], std: Mapping[str, float]) -> str:
    """Return a robot file's text with these parameters, by name, and their deviations; the rest stays.

    InputError names `source`, where the text is from, if it cannot be kept.
    """
    content = yaml.safe_load(text) or {}
    for path, names in _PLACES.items():
        part = content
        for key in path:
            part = part.get(key) or {}
            if not isinstance(part, dict):
                raise InputError(source, ".".join(path), "expected keys and values")
        changed = {}
        for name in names:
            if name in values:
                decimals = _DECIMALS[unit_of(name)]
                changed[name] = round(values[name], decimals) + 0.0
                # A deviation must not be rounded away: the estimator would take the value for exact.
                changed[f"std_{name}"] = max(round(std[name], decimals), 10.0**-decimals)
        if changed:
            text = with_keys(text, path, changed)
    return text


#: Where the parameters are in robot.yaml; the bias of twists has no place there.
_PLACES = {
    ("wheels",): ("left_radius_m", "right_radius_m", "baseline_m"),
    ("camera", "mount"): MOUNT_PARAMETERS,
    ("twist",): ("forward_scale", "turn_scale"),
    (): ("time_offset_s",),
}


def shown_value(name: str, value: float) -> str:
    """Return a parameter as people read it: millimetres, degrees, milliseconds, per cent."""
    match unit_of(name):
        case "m":
            return f"{1e3 * value:.2f} mm"
        case "rad":
            return f"{math.degrees(value):.3f} deg"
        case "rad/s":
            return f"{math.degrees(value):.3f} deg/s"
        case "s":
            return f"{1e3 * value:.1f} ms"
    return f"{value:.5f}"
