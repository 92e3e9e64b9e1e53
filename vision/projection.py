"""Map segments as the camera should see them from a pose.

Ideal pixels (u right, v down from the principal point, focal length f on both axes) are used throughout:
a point of the optical frame (X, Y, Z) has u = f X / Z, v = f Y / Z, and a straight edge stays straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array, Pose2, frozen
from maps.shadows import unhidden_spans
from maps.visibility import shadows_from
from maps.wiremap import WireMap
from vision.camera import Camera

#: Nearer than this to the image plane nothing is in focus, and projections blow up.
NEAR_M = 0.2
#: Shorter predicted pieces carry no evidence of their own.
MIN_PIECE_PX = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The P visible pieces of map segments from one pose.

    `rows`: (P,) rows of the wire map. `ideal_px`: (P, 2, 2) end points, ideal pixels. `depths_m`: (P, 2)
    along the optical axis. `normals`: (P, 3) unit normals of the interpretation planes in the optical
    frame, scaled as `line_normals` says. `spans`: (P, 2) the pieces as parameters from p0 to p1.
    """

    rows: NDArray[np.int64]
    ideal_px: Array
    depths_m: Array
    normals: Array
    spans: Array

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def lengths_px(self) -> Array:
        """Lengths of the pieces in ideal pixels, (P,)."""
        way = self.ideal_px[:, 1] - self.ideal_px[:, 0]
        result: Array = np.hypot(way[:, 0], way[:, 1])
        return result


class Projector:
    """Projects one map through one camera; holds what does not depend on the pose.

    `bounds`: (4,) left, right, top, bottom of what the image can show, at depth 1. `moments`, `directions`:
    (N, 3) p x v and v of each map segment.
    """

    def __init__(self, camera: Camera, wire_map: WireMap) -> None:
        self.camera, self.wire_map = camera, wire_map
        self.bounds = frozen(_field_of_view(camera))
        way = wire_map.endpoints[:, 1] - wire_map.endpoints[:, 0]
        self.directions = frozen(way / np.linalg.norm(way, axis=1)[:, None])
        self.moments = frozen(np.cross(wire_map.endpoints[:, 0], self.directions))

    def predict(
        self,
        pose: Pose2,
        rows: NDArray[np.int64],
        margin_px: float = 0.0,
        deviations: Array | None = None,
    ) -> Prediction:
        """Predict the visible pieces of the segments `rows` (K,) from a pose of the robot.

        `margin_px` widens the image on all sides, for a pose that is known only roughly. `deviations`: (7,) of the
        camera from what it should be, as `vision.pose` estimates them.
        """
        focal = self.camera.focal_px
        rotation, centre = self.camera.map_from_optical(pose, deviations)
        bounds = self.bounds + margin_px / focal * np.array([-1.0, 1.0, -1.0, 1.0])
        optical = (self.wire_map.endpoints[rows] - centre) @ rotation
        framed, clipped = _clip(optical, bounds)
        normals, offsets = shadows_from(self.wire_map, centre)
        which, spans = unhidden_spans(self.wire_map.sight_endpoints[rows[framed]], normals, offsets)
        position, ideal, depths, normals, spans = _project(optical, framed, clipped, which, spans, focal)
        if deviations is not None:
            scale, shift = 1.0 + deviations[4], deviations[5:7]
            normals[:, 2] = normals[:, 2] * scale - normals[:, :2] @ shift / focal
            ideal = ideal * scale + shift
        return Prediction(rows[position], ideal, depths, normals, spans)


def line_normals(ends: Array) -> Array:
    """Return the interpretation-plane normals (..., 3) of segments (..., 2, 3) given in the optical frame.

    Scaled so that `normal . (u, v, f)` is the distance in pixels of the ideal pixel (u, v) from the line.
    """
    normals = np.cross(ends[..., 0, :], ends[..., 1, :])
    scale = np.maximum(np.hypot(normals[..., 0], normals[..., 1]), 1e-12)
    result: Array = normals / scale[..., None]
    return result


def _field_of_view(camera: Camera) -> Array:
    """Return left, right, top and bottom of what the image can show, at depth 1."""
    u, v = np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)
    border = np.concatenate(
        [np.column_stack([u, np.full(33, edge)]) for edge in (0.0, camera.height - 1.0)]
        + [np.column_stack([np.full(33, edge), v]) for edge in (0.0, camera.width - 1.0)]
    )
    x, y = camera.undistort(border).T
    return np.array([x.min(), x.max(), y.min(), y.max()])


@njit(cache=True, nogil=True)
def framed_span(ends: Array, bounds: Array) -> tuple[float, float]:
    """The stretch of a segment (2, 3), optical frame, that the image can show; empty: (1, 0)."""
    low, high = 0.0, 1.0
    for plane in range(5):
        if plane == 4:
            first, last = ends[0, 2] - NEAR_M, ends[1, 2] - NEAR_M
        else:
            axis, sign = plane // 2, 1.0 - 2.0 * (plane % 2)
            first = sign * (ends[0, axis] - bounds[plane] * ends[0, 2])
            last = sign * (ends[1, axis] - bounds[plane] * ends[1, 2])
        if first <= 0.0 and last <= 0.0:
            return 1.0, 0.0
        if last > first:
            low = max(low, first / (first - last))
        elif last < first:
            high = min(high, first / (first - last))
    return (low, high) if low < high else (1.0, 0.0)


@njit(cache=True, nogil=True)
def _clip(optical: Array, bounds: Array) -> tuple[NDArray[np.int64], Array]:
    """Which segments (K, 2, 3) the image can show, (F,), and which stretch of each, (F, 2)."""
    framed, spans = np.empty(len(optical), np.int64), np.empty((len(optical), 2))
    count = 0
    for k in range(len(optical)):
        low, high = framed_span(optical[k], bounds)
        if low < high:
            framed[count] = k
            spans[count, 0], spans[count, 1] = low, high
            count += 1
    return framed[:count], spans[:count]


@njit(cache=True, nogil=True)
def _project(
    optical: Array,
    framed: NDArray[np.int64],
    clipped: Array,
    which: NDArray[np.int64],
    visible: Array,
    focal: float,
) -> tuple[NDArray[np.int64], Array, Array, Array, Array]:
    """Project the visible stretches that the image shows: which rows, ideal pixels, depths, normals, stretches.

    `visible`: (V, 2) stretches that nothing hides, of the framed segments `which` (V,).
    """
    count = 0
    rows = np.empty(len(which), np.int64)
    ideal, normals = np.empty((len(which), 2, 2)), np.empty((len(which), 3))
    depths, spans = np.empty((len(which), 2)), np.empty((len(which), 2))
    for at in range(len(which)):
        low = max(clipped[which[at], 0], visible[at, 0])
        high = min(clipped[which[at], 1], visible[at, 1])
        if low >= high:
            continue
        ends = optical[framed[which[at]]]
        for end in range(2):
            along = low if end == 0 else high
            spans[count, end] = along
            depths[count, end] = ends[0, 2] + along * (ends[1, 2] - ends[0, 2])
            for axis in range(2):
                place = ends[0, axis] + along * (ends[1, axis] - ends[0, axis])
                ideal[count, end, axis] = focal * place / depths[count, end]
        u, v = ideal[count, 0]
        du, dv = ideal[count, 1, 0] - u, ideal[count, 1, 1] - v
        length = math.hypot(du, dv)
        if length >= MIN_PIECE_PX:
            rows[count] = framed[which[at]]
            # The line through both ends: positive for pixels on the left-hand side in an image with v down.
            normals[count, 0], normals[count, 1] = -dv / length, du / length
            normals[count, 2] = (dv * u - du * v) / (length * focal)
            count += 1
    return rows[:count], ideal[:count], depths[:count], normals[:count], spans[:count]
