"""How many map edges can be seen in a picture, and how many of them a line detector finds there.

For the evaluation alone: it knows where the picture was taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from vision.images import GreyImage
from vision.lsd import find_lsd
from vision.projection import Projector

#: Edges of this length in the image count, looked at every so often.
LEAST_PX = 40.0
_STEP_M = 0.05
#: A line supports an edge where it lies this near, and runs along it as nearly as this.
_NEAR_PX, _PARALLEL = 3.0, math.sin(math.radians(5.0))


@dataclass(frozen=True, slots=True)
class Observed:
    """Map edges of 40 px or more in a picture, and those that LSD finds along half of what shows of them."""

    visible: int
    observable: int


def observed(image: GreyImage, projector: Projector, pose: Pose2) -> Observed:
    """Count the edges of a projector's map in a picture (H, W) that was taken from a pose of the robot."""
    number = len(projector.wire_map)
    seen = projector.predict(pose, np.arange(number))
    long = np.bincount(seen.rows, seen.lengths_px, minlength=number) >= LEAST_PX
    pieces = np.flatnonzero(long[seen.rows])
    owner, points_px, along_px = _samples(projector, pose, seen.rows[pieces], seen.spans[pieces])
    found = _supported(points_px, along_px, find_lsd(image))
    share = np.bincount(owner, found, minlength=number) / np.maximum(np.bincount(owner, minlength=number), 1)
    return Observed(int(np.count_nonzero(long)), int(np.count_nonzero(long & (share >= 0.5))))


def _samples(
    projector: Projector, pose: Pose2, rows: NDArray[np.int64], spans: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Points along the pieces (P,) of segments: their rows (S,), raw pixels (S, 2), directions there (S, 2)."""
    camera = projector.camera
    rotation, centre = camera.map_from_optical(pose)
    first, way = (
        projector.wire_map.endpoints[rows, 0],
        np.diff(projector.wire_map.endpoints[rows], axis=1)[:, 0],
    )
    lengths_m = np.linalg.norm(way, axis=1) * (spans[:, 1] - spans[:, 0])
    counts = np.maximum(3, (lengths_m / _STEP_M).astype(np.int64))
    piece = np.repeat(np.arange(len(rows)), counts)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = spans[piece, 0] + (number + 0.5) / counts[piece] * (spans[piece, 1] - spans[piece, 0])
    here = first[piece] + share[:, None] * way[piece]
    ahead = here + 0.01 * way[piece] / np.linalg.norm(way[piece], axis=1)[:, None]
    optical = (np.stack([here, ahead]) - centre) @ rotation
    pixels = camera.distort((optical[..., :2] / optical[..., 2:]).reshape(-1, 2)).reshape(2, -1, 2)
    along = pixels[1] - pixels[0]
    return rows[piece], pixels[0], along / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]


def _supported(points_px: Array, along_px: Array, lines_px: Array) -> NDArray[np.bool_]:
    """Tell which points (S, 2), of edges that run along (S, 2), lie on one of the lines (M, 2, 2)."""
    way = lines_px[:, 1] - lines_px[:, 0]
    length = np.linalg.norm(way, axis=1)
    way = way / np.maximum(length, 1e-12)[:, None]
    away = points_px[:, None] - lines_px[:, 0]
    across = np.abs(away[..., 0] * way[:, 1] - away[..., 1] * way[:, 0])
    turned = np.abs(along_px[:, None, 0] * way[:, 1] - along_px[:, None, 1] * way[:, 0])
    beside = (away * way).sum(axis=2)
    on = (across < _NEAR_PX) & (turned < _PARALLEL) & (beside > -_NEAR_PX) & (beside < length + _NEAR_PX)
    result: NDArray[np.bool_] = on.any(axis=1)
    return result
