"""The camera that a command works with, and whether an image is one of its."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from maps.errors import InputError

if TYPE_CHECKING:
    from vision.camera import Camera
    from vision.images import GreyImage


def camera_of(path: Path) -> Camera:
    """Read the camera in a robot.yaml; InputError where there is none."""
    from runs.robot import read_robot

    camera = read_robot(path).camera
    if camera is None:
        raise InputError(path, "camera", "missing")
    return camera


def check_size(image: GreyImage, camera: Camera, path: Path) -> None:
    """Refuse an image (H, W), read from a path, that is not as large as the camera's: InputError."""
    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        expected = f"{camera.width}x{camera.height}"
        raise InputError(path, "", f"is {width}x{height}, but the camera makes {expected}")
