"""OpenCV's LSD (von Gioi et al. 2010) as another line extractor, to compare with."""

from __future__ import annotations

import cv2
import numpy as np

from maps.poses import Array
from vision.camera import Camera
from vision.images import GreyImage

#: OpenCV's LSD works at 0.8 of the size and scales back without moving the pixels' centres, which puts all
#: it finds this much too far left and up.
_SHIFT_PX = 0.125
#: Contrast is looked up at so many places along a line, so far to either side.
_LOOKS = 16
_BESIDE_PX = 2.0


def find_lsd(image: GreyImage) -> Array:
    """Return the ends (M, 2, 2) of LSD's segments, raw pixels, with OpenCV's default parameters."""
    if min(image.shape) < 3:
        return np.zeros((0, 2, 2))
    found = cv2.createLineSegmentDetector().detect(image)[0]
    if found is None:
        return np.zeros((0, 2, 2))
    result: Array = np.asarray(found, np.float64).reshape(-1, 2, 2) + _SHIFT_PX
    return result


def brighter_right(image: GreyImage, raw: Array) -> Array:
    """Return by how many grey levels the right-hand side of segments (M, 2, 2) is brighter, (M,)."""
    along = raw[:, 1] - raw[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    right = _BESIDE_PX * along[:, ::-1] * [-1.0, 1.0] / length
    share = (np.arange(_LOOKS) + 0.5)[:, None] / _LOOKS
    places = raw[:, :1] + share * along[:, None]
    high = np.array(image.shape[::-1]) - 1
    levels = []
    for side in (places + right[:, None], places - right[:, None]):
        x, y = np.moveaxis(np.clip(np.rint(side), 0, high).astype(np.int64), 2, 0)
        levels.append(image[y, x].astype(np.float64).mean(axis=1))
    result: Array = levels[0] - levels[1]
    return result


def straightened(raw: Array, camera: Camera) -> Array:
    """Undistort segments (M, 2, 2) that were laid through edges bowed by the lens, into ideal pixels.

    The line that fits a shallow arc best crosses it at 1 / sqrt(12) of its length either side of the middle:
    there the edge is, and not at the line's ends.
    """
    middle, half = raw.mean(axis=1, keepdims=True), 0.5 * (raw[:, 1:] - raw[:, :1])
    crossings = middle + half * np.array([[-1.0], [1.0]]) / np.sqrt(3.0)
    points = camera.undistort(np.concatenate([raw, crossings], axis=1).reshape(-1, 2)).reshape(-1, 4, 2)
    ends, crossings = points[:, :2] * camera.focal_px, points[:, 2:] * camera.focal_px
    along = crossings[:, 1:] - crossings[:, :1]
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    result: Array = crossings[:, :1] + ((ends - crossings[:, :1]) * along).sum(axis=2, keepdims=True) * along
    return result
