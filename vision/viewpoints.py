"""Places from which it is worked out what can be seen, each standing for all hypotheses near it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array
from maps.visibility import visible_spans
from vision.projection import Projector

#: In a window larger than this one viewpoint does not stand for all; four more lie around the centre.
_SMALL_M = 0.2
_AROUND = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """What a camera turned all around sees from some places of the robot.

    `places`: (V, 2) in plan. From place v it sees stretches `pieces` (Q, 2, 3), metres, map frame, of the segments
    `rows` (Q,), numbers starts[v] to starts[v + 1], `starts`: (V + 1,).
    """

    places: Array
    rows: NDArray[np.int64]
    pieces: Array
    starts: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.places)

    def nearest(self, poses: Array) -> NDArray[np.int64]:
        """Return the place (H,) nearest to each pose (H, 3); for a few places."""
        squares = ((poses[:, None, :2] - self.places) ** 2).sum(axis=2)
        result: NDArray[np.int64] = squares.argmin(axis=1)
        return result


def viewpoints_in(projector: Projector, window: SearchWindow, rows: NDArray[np.int64]) -> Viewpoints:
    """Return viewpoints that stand for a window, seeing some of `rows`; but for the centre all are on the floor."""
    centre = window.centre.as_array()[:2]
    places = centre[None]
    if window.dt_m > _SMALL_M:
        turns = np.arange(4) * math.pi / 2.0 + window.centre.phi
        around = centre + _AROUND * window.dt_m * np.column_stack([np.cos(turns), np.sin(turns)])
        free = shapely.contains_xy(projector.wire_map.floor, around[:, 0], around[:, 1])
        places = np.concatenate([places, around[free]])
    return views_from(projector, places, [rows] * len(places))


def views_from(projector: Projector, places: Array, rows: list[NDArray[np.int64]]) -> Viewpoints:
    """Return what is seen from places (V, 2), of `rows` that may be visible from each."""
    wire_map, height = projector.wire_map, projector.camera.mount.height_m
    seen = [
        visible_spans(wire_map, np.array([x, y, height]), here)
        for (x, y), here in zip(places, rows, strict=True)
    ]
    owners = np.concatenate([here[which] for here, (which, _) in zip(rows, seen, strict=True)])
    spans = np.concatenate([spans for _, spans in seen])
    ends = wire_map.endpoints[owners]
    pieces = ends[:, :1] + spans[:, :, None] * (ends[:, 1:] - ends[:, :1])
    starts = np.concatenate([[0], np.cumsum([len(which) for which, _ in seen])])
    return Viewpoints(places, owners, pieces, starts.astype(np.int64))
