"""Undistortion of many points at once, by a table of one camera."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from maps.poses import Array, frozen
from vision.camera import Camera, CameraModel

#: Pixels from one entry of the table to the next. Between them distortion bends by a hundredth of a pixel in
#: the corners of a wide lens, by far less elsewhere.
_STRIDE = 2


def straighten(points_px: Array, camera: Camera) -> Array:
    """Undistort raw pixels (N, 2) inside the image into ideal pixels (N, 2), as `ImageSegments` has them.

    Not finite where the camera's model has no ray.
    """
    if camera.model is CameraModel.PINHOLE_RADTAN and not camera.distortion.any():
        return _scaled(
            points_px, camera.cx, camera.cy, camera.focal_px / camera.fx, camera.focal_px / camera.fy
        )
    result: Array = _interpolated(points_px, _table(camera))
    return result


@lru_cache(maxsize=2)
def _table(camera: Camera) -> Array:
    """Ideal pixels of every `_STRIDE`-th raw one, (rows, columns, 2), a little beyond the image."""
    u, v = (_STRIDE * np.arange(size // _STRIDE + 2) for size in (camera.width, camera.height))
    raw = np.stack(np.meshgrid(u, v), axis=2)
    ideal = camera.undistort(raw.reshape(-1, 2).astype(np.float64)) * camera.focal_px
    return frozen(ideal.reshape(raw.shape))


@njit(cache=True, nogil=True)
def _scaled(points: Array, cx: float, cy: float, scale_x: float, scale_y: float) -> Array:
    result = np.empty((len(points), 2))
    for row in range(len(points)):
        result[row, 0] = (points[row, 0] - cx) * scale_x
        result[row, 1] = (points[row, 1] - cy) * scale_y
    return result


@njit(cache=True, nogil=True)
def _interpolated(points: Array, table: Array) -> Array:
    """Bilinear interpolation."""
    result = np.empty((len(points), 2))
    for row in range(len(points)):
        u, v = points[row, 0] / _STRIDE, points[row, 1] / _STRIDE
        i = min(max(int(v), 0), table.shape[0] - 2)
        j = min(max(int(u), 0), table.shape[1] - 2)
        u, v = u - j, v - i
        for axis in range(2):
            upper = (1.0 - u) * table[i, j, axis] + u * table[i, j + 1, axis]
            lower = (1.0 - u) * table[i + 1, j, axis] + u * table[i + 1, j + 1, axis]
            result[row, axis] = (1.0 - v) * upper + v * lower
    return result
