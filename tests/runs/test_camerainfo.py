"""ROS camera_info files: what is read, what is refused, and that it comes back as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from boardviews import BARREL, FISHEYE

from maps.errors import InputError
from runs.camerainfo import read_camera_info, write_camera_info
from vision.camera import Camera, CameraModel

#: As camera_calibration writes it.
ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [533.17, 0.0, 342.25, 0.0, 533.25, 234.07, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.29, 0.1, 0.001, -0.00007, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [480.0, 0.0, 345.0, 0.0, 0.0, 510.0, 233.0, 0.0, 0.0, 0.0, 1.0, 0.0]
"""


def read(tmp_path: Path, content: dict[str, Any]) -> Camera:
    path = tmp_path / "camera_info.yaml"
    path.write_text(yaml.safe_dump(content))
    return read_camera_info(path)


def document() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(ROS)
    return content


def test_what_ros_writes_is_read(tmp_path: Path) -> None:
    camera = read(tmp_path, document())
    assert camera.model is CameraModel.PINHOLE_RADTAN
    assert (camera.width, camera.height) == (640, 480)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (533.17, 533.25, 342.25, 234.07)
    assert camera.distortion.tolist() == [-0.29, 0.1, 0.001, -0.00007, 0.0]


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_there_and_back(tmp_path: Path, camera: Camera) -> None:
    write_camera_info(tmp_path / "camera_info.yaml", camera)
    back = read_camera_info(tmp_path / "camera_info.yaml")
    assert (back.model, back.width, back.height) == (camera.model, camera.width, camera.height)
    np.testing.assert_array_equal(back.matrix, camera.matrix)
    np.testing.assert_array_equal(back.distortion, camera.distortion)
    written = yaml.safe_load((tmp_path / "camera_info.yaml").read_text())
    assert list(written) == list(document())
    assert written["projection_matrix"]["data"][3::4] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ([], [0.0] * 5),
        ([0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 0.3, 0.4, 0.0]),
        ([0.1, *[0.0] * 7], [0.1, *[0.0] * 4]),
    ],
)
def test_missing_coefficients_are_zero_and_superfluous_zeros_are_dropped(
    tmp_path: Path, given: list[float], kept: list[float]
) -> None:
    content = document() | {"distortion_model": "rational_polynomial"}
    content["distortion_coefficients"] = {"rows": 1, "cols": len(given), "data": given}
    assert read(tmp_path, content).distortion.tolist() == kept


def matrix(*data: float) -> dict[str, Any]:
    return {"rows": 3, "cols": 3, "data": list(data)}


@pytest.mark.parametrize(
    ("key", "value", "where"),
    [
        ("image_width", 0, "image_width"),
        ("image_height", None, "image_height"),
        ("camera_matrix", matrix(*[0.0] * 9), "camera_matrix"),
        ("camera_matrix", matrix(500, 0.5, 320, 0, 500, 240, 0, 0, 1), "camera_matrix"),
        ("camera_matrix", matrix(500, 0, 320, 0, 500, 240, 0, 0), "camera_matrix"),
        ("camera_matrix", matrix(500, 0, float("nan"), 0, 500, 240, 0, 0, 1), "camera_matrix.data[2]"),
        ("distortion_model", "thin_prism", "distortion_model"),
        ("distortion_coefficients", {"rows": 1, "cols": 8, "data": [0.1] * 8}, "distortion_coefficients"),
    ],
)
def test_what_is_no_calibrated_camera_is_refused(tmp_path: Path, key: str, value: Any, where: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, document() | {key: value})
    assert caught.value.where == where


def test_a_missing_matrix_is_named(tmp_path: Path) -> None:
    content = document()
    del content["camera_matrix"]
    with pytest.raises(InputError, match="camera_matrix: field required"):
        read(tmp_path, content)
