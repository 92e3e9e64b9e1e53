"""ROS camera_info files, as camera_calibration and image drivers read and write them.

The format is that of camera_calibration_parsers: `camera_matrix` K, `distortion_coefficients` D of a
`distortion_model`, and, for rectified images, which are not used here, `rectification_matrix` and
`projection_matrix`. Pixels are counted as here: integers are pixel centres.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

import numpy as np
import yaml
from pydantic import BaseModel, Field, model_validator

from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.mapdocument import write_whole
from maps.poses import Array
from vision.camera import Camera, CameraModel, CameraMount

Finite = Annotated[float, Field(allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=2**16)]

#: ROS's names of the models, and how many coefficients they may have; all but the first are read only.
_MODELS = {
    "plumb_bob": (CameraModel.PINHOLE_RADTAN, 5),
    "equidistant": (CameraModel.FISHEYE, 4),
    "rational_polynomial": (CameraModel.PINHOLE_RADTAN, 5),
    "fisheye": (CameraModel.FISHEYE, 4),
}


class _Matrix(BaseModel):
    rows: int
    cols: int
    data: list[Finite]

    @model_validator(mode="after")
    def _is_full(self) -> Self:
        if self.rows * self.cols != len(self.data):
            raise ValueError(f"{len(self.data)} numbers for {self.rows} x {self.cols}")
        return self


class _CameraInfo(BaseModel):
    image_width: Pixels
    image_height: Pixels
    camera_matrix: _Matrix
    distortion_model: str = "plumb_bob"
    distortion_coefficients: _Matrix


def read_camera_info(path: Path) -> Camera:
    """Read a camera from ROS's file; its mount is not in there, and that of a `CameraMount()`.

    InputError names the key that is missing, does not fit, or tells of a lens that the models do not have.
    """
    info = checked(_CameraInfo, read_yaml(path), path)
    size = info.image_width, info.image_height
    return camera_of_info(
        path, size, info.distortion_model, info.camera_matrix.data, info.distortion_coefficients.data
    )


def camera_of_info(
    path: Path, size: tuple[int, int], ros_model: str, camera_matrix: list[float], given: list[float]
) -> Camera:
    """Return the camera of ROS's numbers: its (width, height), D's model, K row by row, and D.

    InputError names the key that does not fit, or tells of a lens that the models do not have.
    """
    if ros_model not in _MODELS:
        known = ", ".join(_MODELS)
        raise InputError(path, "distortion_model", f"{ros_model!r} is none of {known}")
    model, count = _MODELS[ros_model]
    if any(given[count:]):
        raise InputError(path, "distortion_coefficients", f"only the first {count} may differ from zero")
    matrix = np.array(camera_matrix)
    if len(matrix) != 9 or not (matrix[0] > 0.0 and matrix[4] > 0.0):
        raise InputError(path, "camera_matrix", "not that of a calibrated camera: fx and fy above zero")
    if matrix[[1, 3, 6, 7]].any() or matrix[8] != 1.0:
        raise InputError(path, "camera_matrix", "not of the form fx 0 cx, 0 fy cy, 0 0 1")
    distortion = np.zeros(count)
    distortion[: min(len(given), count)] = given[:count]
    fx, fy, cx, cy = matrix[[0, 4, 2, 5]].tolist()
    return Camera(model, *size, fx, fy, cx, cy, distortion, CameraMount())


def ros_model_of(camera: Camera) -> str:
    """Return ROS's name of a camera's model."""
    return next(ros for ros, (model, _) in _MODELS.items() if model is camera.model)


def write_camera_info(path: Path, camera: Camera, name: str = "camera") -> None:
    """Write a camera for ROS; rectified images keep its intrinsics. There whole, or not at all."""
    content = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "camera_matrix": _plain(camera.matrix),
        "distortion_model": ros_model_of(camera),
        "distortion_coefficients": _plain(camera.distortion[None]),
        "rectification_matrix": _plain(np.eye(3)),
        "projection_matrix": _plain(np.column_stack([camera.matrix, np.zeros(3)])),
    }
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=10**6)
    write_whole(path, text.encode())


def _plain(matrix: Array) -> dict[str, object]:
    rows, cols = matrix.shape
    return {"rows": rows, "cols": cols, "data": matrix.ravel().tolist()}
