"""Rooms: what remains of the floor when it is cut under lintels and at passages as narrow as a door.

A map does not say what its rooms are; this guess serves its examination, and no estimate rests on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiLineString, Polygon

from maps.poses import Array
from maps.wiremap import WireMap

#: Floor narrower than twice this is a passage, not a room.
HALF_PASSAGE_M = 0.5
#: Edges in a passage, or in a niche too narrow for a room, belong to the room within this distance.
_REACH_M = 0.5
#: Wider than the rounding of a file, narrower than any wall.
_CUT_M = 0.02

#: Two heights nearer to each other than this are one level.
LEVEL_M = 0.05
#: What stands no higher than this stands on the floor.
FOOT_M = 0.1
#: At its ceiling a room has edges along this share of its outline, or this many corners reach it.
_CEILING_SHARE, _CEILING_CORNERS = 0.25, 3


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A part of the floor: its outline (metres, map frame), and the rows of the segments in it."""

    outline: Polygon
    rows: NDArray[np.int64]

    @property
    def name(self) -> str:
        """Where the room is; files do not name rooms."""
        place = self.outline.representative_point()
        return f"room at ({place.x:.1f}, {place.y:.1f})"


def rooms_of(wire_map: WireMap) -> tuple[Room, ...]:
    """Split a map's floor into rooms by a morphological opening, and give each its segments."""
    cuts = MultiLineString(list(wire_map.lintels)).buffer(_CUT_M, cap_style="square")
    cut = wire_map.floor.difference(cuts)
    cores = cut.buffer(-HALF_PASSAGE_M, join_style="mitre")
    outlines = []
    for core in shapely.get_parts(cores):
        grown = core.buffer(HALF_PASSAGE_M, join_style="mitre").intersection(cut)
        outlines += [max(shapely.get_parts(grown), key=lambda part: float(part.area))]
    outlines = [outline for outline in outlines if isinstance(outline, Polygon) and outline.area > 0.0]
    if not outlines:
        return ()
    middles = shapely.points(wire_map.sight_endpoints.mean(axis=1)[:, :2])
    distances = np.array([shapely.distance(outline, middles) for outline in outlines])
    nearest = np.where(distances.min(axis=0) <= _REACH_M, distances.argmin(axis=0), -1)
    return tuple(Room(outline, np.flatnonzero(nearest == row)) for row, outline in enumerate(outlines))


def vertical(endpoints: Array) -> NDArray[np.bool_]:
    """Mark the segments (N, 2, 3) that rise more than ten times as much as they lean, (N,)."""
    way = np.abs(endpoints[:, 1] - endpoints[:, 0])
    return way[:, 2] > 10.0 * np.hypot(way[:, 0], way[:, 1])


def ceiling_of(room: Room, wire_map: WireMap) -> float | None:
    """Return the height of a room's ceiling [m]; None where its edges do not show one.

    It is the highest level that level edges follow along a quarter of the outline, or that three upright
    edges reach from the floor: a single edge measured too high makes no ceiling.
    """
    edges = wire_map.endpoints[room.rows]
    low, high = edges[:, :, 2].min(axis=1), edges[:, :, 2].max(axis=1)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    level, rising = high - low < LEVEL_M, vertical(edges) & (low < FOOT_M)
    for height in np.sort(high)[::-1]:
        at = np.abs(high - height) < LEVEL_M
        follows = lengths[at & level].sum() > _CEILING_SHARE * room.outline.length
        if height > FOOT_M and (follows or np.count_nonzero(at & rising) >= _CEILING_CORNERS):
            return float(height)
    return None
