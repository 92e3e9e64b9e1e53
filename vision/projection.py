"""Map segments as the camera should see them from a pose.

Ideal pixels (u right, v down from the principal point, focal length f on both axes) are used throughout:
a point of the optical frame (X, Y, Z) has u = f X / Z, v = f Y / Z, and a straight edge stays straight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from maps.visibility import inside_interval, visible_spans
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
    frame, scaled as `line_normals` says.
    """

    rows: NDArray[np.int64]
    ideal_px: Array
    depths_m: Array
    normals: Array

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def lengths_px(self) -> Array:
        """Lengths of the pieces in ideal pixels, (P,)."""
        result: Array = np.linalg.norm(self.ideal_px[:, 1] - self.ideal_px[:, 0], axis=1)
        return result


class Projector:
    """Projects one map through one camera; holds what does not depend on the pose."""

    def __init__(self, camera: Camera, wire_map: WireMap) -> None:
        self.camera, self.wire_map = camera, wire_map
        self._bounds = _field_of_view(camera)

    def predict(self, pose: Pose2, rows: NDArray[np.int64], margin_px: float = 0.0) -> Prediction:
        """Predict the visible pieces of the segments `rows` (K,) from a pose of the robot.

        `margin_px` widens the image on all sides, for a pose that is known only roughly.
        """
        focal = self.camera.focal_px
        rotation, centre = self.camera.map_from_optical(pose)
        optical = (self.wire_map.endpoints[rows] - centre) @ rotation
        low, high = _clip(optical, self._bounds + [0.0, 0.0, margin_px / focal])
        framed = np.flatnonzero(low < high)
        position, spans = visible_spans(self.wire_map, centre, rows[framed])
        position = framed[position]
        spans = np.clip(spans, low[position, None], high[position, None])
        start, end = optical[position, 0, None], optical[position, 1, None]
        ends = start + spans[..., None] * (end - start)
        ideal = focal * ends[..., :2] / ends[..., 2:]
        long = np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1) >= MIN_PIECE_PX
        return Prediction(rows[position][long], ideal[long], ends[long][..., 2], line_normals(ends[long]))


def line_normals(ends: Array) -> Array:
    """Return the interpretation-plane normals (..., 3) of segments (..., 2, 3) given in the optical frame.

    Scaled so that `normal . (u, v, f)` is the distance in pixels of the ideal pixel (u, v) from the line.
    """
    normals = np.cross(ends[..., 0, :], ends[..., 1, :])
    scale = np.maximum(np.linalg.norm(normals[..., :2], axis=-1), 1e-12)
    result: Array = normals / scale[..., None]
    return result


def _field_of_view(camera: Camera) -> Array:
    """Return half-spaces normal . p > 0, (4, 3), that bound what the image can show."""
    u, v = np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)
    border = np.concatenate(
        [np.column_stack([u, np.full(33, edge)]) for edge in (0.0, camera.height - 1.0)]
        + [np.column_stack([np.full(33, edge), v]) for edge in (0.0, camera.width - 1.0)]
    )
    x, y = camera.undistort(border).T
    return np.array([[1.0, 0.0, -x.min()], [-1.0, 0.0, x.max()], [0.0, 1.0, -y.min()], [0.0, -1.0, y.max()]])


def _clip(optical: Array, bounds: Array) -> tuple[Array, Array]:
    """Return parameters low, high (K,) of the parts of segments (K, 2, 3) inside the field of view."""
    start, end = ([*(bounds @ optical[:, end].T), optical[:, end, 2] - NEAR_M] for end in (0, 1))
    return inside_interval(start, end)
