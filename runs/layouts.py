"""Folders of other projects as sessions: EuRoC (ASL) and TUM RGB-D layouts.

Neither knows wheels or a map of edges: odometry.csv, robot.yaml and map.yaml are put beside them, as in a session.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field

from maps.documents import checked, read_text, read_yaml
from maps.errors import InputError
from runs.folder import to_ns
from runs.robot import Robot, read_robot
from runs.session import Frame, Session, image_path, read_odometry, session_of
from runs.tables import MAX_TIME_S
from vision.camera import BASE_FROM_OPTICAL, Camera, CameraModel, mount_of

EUROC_CAMERA = Path("mav0") / "cam0"
TUM_IMAGES = "rgb.txt"

Finite = Annotated[float, Field(allow_inf_nan=False)]


#: Of a rotation and a mount; what is beyond overflows when it is squared.
Modest = Annotated[float, Field(ge=-1e3, le=1e3)]


class _Transform(BaseModel):
    data: list[Modest] = Field(min_length=16, max_length=16)


class _Sensor(BaseModel):
    """A camera's sensor.yaml; T_BS is body_from_sensor."""

    T_BS: _Transform
    resolution: tuple[Annotated[int, Field(ge=1, le=2**16)], Annotated[int, Field(ge=1, le=2**16)]]
    camera_model: Literal["pinhole"]
    intrinsics: list[Finite] = Field(min_length=4, max_length=4)
    distortion_model: Literal["radial-tangential", "equidistant"]
    distortion_coefficients: list[Finite] = Field(min_length=4, max_length=4)


def is_layout(folder: Path) -> bool:
    """Whether a folder is of one of these layouts, and no session folder."""
    if (folder / "frames.csv").exists():
        return False
    return (folder / EUROC_CAMERA).is_dir() or (folder / TUM_IMAGES).is_file()


def read_layout(folder: Path, map_path: Path | None = None, robot_path: Path | None = None) -> Session:
    """Read such a folder as a session; of EuRoC's the first camera.

    A camera that robot.yaml has not comes from EuRoC's sensor.yaml, with its body as the robot's base frame.
    InputError names the file, and the line or key, of what is missing or cannot be.
    """
    robot = read_robot(robot_path or folder / "robot.yaml")
    odometry = read_odometry(folder / "odometry.csv", robot)
    if (folder / EUROC_CAMERA).is_dir():
        if robot.camera is None:
            robot = replace(robot, camera=_sensor(folder / EUROC_CAMERA / "sensor.yaml"))
        frames = _frames(folder, folder / EUROC_CAMERA / "data.csv", robot, ",", EUROC_CAMERA / "data")
    else:
        frames = _frames(folder, folder / TUM_IMAGES, robot, None, Path())
    return session_of(folder, robot, odometry, frames, (), map_path)


def _frames(folder: Path, table: Path, robot: Robot, comma: str | None, under: Path) -> tuple[Frame, ...]:
    """Read rows of a stamp and a file's name: EuRoC's in nanoseconds with commas, TUM's in seconds with blanks."""
    frames: list[Frame] = []
    for number, line in enumerate(read_text(table).splitlines(), start=1):
        words = [word.strip() for word in line.split(comma)]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            stamped, name = words
            stamp_ns = int(stamped) if comma else to_ns(stamped)
            if not 0 <= stamp_ns <= MAX_TIME_S * 1e9:
                raise ValueError(f"{stamped} is no time")
            filename = str(under / name)
            path = image_path(folder, filename)
        except ValueError as error:
            raise InputError(table, f"line {number}", f"not a stamp and a file's name: {error}") from None
        stamp_ns += robot.time_offset_ns
        if frames and stamp_ns <= frames[-1].stamp_ns:
            raise InputError(table, f"line {number}", "stamps do not rise")
        frames.append(Frame(stamp_ns, stamp_ns, filename, path))
    if not frames:
        raise InputError(table, "", "no rows")
    return tuple(frames)


def _sensor(path: Path) -> Camera:
    """Return the camera of a sensor.yaml."""
    sensor: Any = checked(_Sensor, read_yaml(path), path)
    fisheye = sensor.distortion_model == "equidistant"
    fx, fy, cx, cy = sensor.intrinsics
    if fx <= 0.0 or fy <= 0.0:
        raise InputError(path, "intrinsics", "focal lengths are not above zero")
    body_from_camera = np.reshape(sensor.T_BS.data, (4, 4))
    rotation = body_from_camera[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise InputError(path, "T_BS", "no rotation")
    try:
        mount = mount_of(rotation @ BASE_FROM_OPTICAL.T, body_from_camera[:3, 3])
    except ValueError as error:
        raise InputError(path, "T_BS", str(error)) from None
    width, height = sensor.resolution
    coefficients = [*sensor.distortion_coefficients, *([] if fisheye else [0.0])]
    model = CameraModel.FISHEYE if fisheye else CameraModel.PINHOLE_RADTAN
    return Camera(model, width, height, fx, fy, cx, cy, np.array(coefficients), mount)
