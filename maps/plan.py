"""A map in plan, for visibility regardless of heights: only walls hide, and everything may be seen.

Besides the segments it has rows for the walls, low obstacles and lintels themselves: what hides something must
itself be seen, so a cell needs to consider only those that it sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.floor import into_floor
from maps.poses import Array, frozen
from maps.shadows import shadows_of, unhidden_spans
from maps.visibility import cross_plan
from maps.wiremap import WireMap

#: As little as keeps an edge off its own wall.
_NUDGE_M = 1e-3
#: Plan shapes nearer than this are the same.
_SAME_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Rows of plan segments `sight` (R, 2, 3), z = 0, all inside the floor, and the `walls` (W, 2, 2) that hide.

    First come the distinct plan shapes of the map's segments, then the walls, low walls, and lintels. A segment has
    two shapes, well inside the floor and as it is, since an edge on a door's jamb is seen from slightly different
    places depending on how far it is moved off the wall, and a list that must not miss it has to allow both.
    `members`: (M, 2) pairs of a row and a segment of the map that has this shape, in order.
    """

    sight: Array
    walls: Array
    members: NDArray[np.int64]
    first_wall: int
    low_walls: int

    def segments_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the map's segments that have one of the rows' shapes."""
        return np.unique(self.members[np.isin(self.members[:, 0], rows), 1])

    def low_walls_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which low walls are among rows, numbered from 0."""
        first = self.first_wall + len(self.walls)
        return rows[(rows >= first) & (rows < first + self.low_walls)] - first

    def lintels_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which lintels are among rows, numbered from 0."""
        first = self.first_wall + len(self.walls) + self.low_walls
        return rows[rows >= first] - first

    def seen(self, eye: Array, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which of `rows` (K,), in order, are seen from `eye` (2,); the walls that hide are among them."""
        is_wall = (rows >= self.first_wall) & (rows < self.first_wall + len(self.walls))
        walls, others = rows[is_wall] - self.first_wall, rows[~is_wall]
        walls = walls[
            cross_plan(self.walls[walls, 1] - self.walls[walls, 0], eye - self.walls[walls, 0]) > 0.0
        ]
        walls = walls[self._unhidden(eye, self.first_wall + walls, walls)]
        others = others[self._unhidden(eye, others, walls)]
        return np.sort(np.concatenate([others, self.first_wall + walls]))

    def _unhidden(self, eye: Array, rows: NDArray[np.int64], walls: NDArray[np.int64]) -> NDArray[np.int64]:
        """Positions of the rows that some walls (numbered from 0) do not hide whole."""
        eye = np.append(eye, 0.0)
        shadows = shadows_of(self.walls[walls], eye, 1e-9, np.full(len(walls), np.inf), True)
        return np.unique(unhidden_spans(self.sight[rows], *shadows)[0])


def plan_of(wire_map: WireMap) -> Plan:
    """Return a map's plan."""
    tall = np.isinf(wire_map.wall_tops_m)
    as_they_are = np.concatenate(
        [wire_map.endpoints[:, :, :2], wire_map.walls[tall], wire_map.walls[~tall], wire_map.lintels]
    )
    nudged = into_floor(wire_map.floor, as_they_are.reshape(-1, 2), _NUDGE_M).reshape(-1, 2, 2)
    shapes = np.concatenate([wire_map.sight_endpoints[:, :, :2], nudged[: len(wire_map)]])
    # The same edge up and down a wall, and in either direction, is one shape.
    keys = np.round(shapes / _SAME_M).astype(np.int64)
    swapped = (keys[:, 0, 0] > keys[:, 1, 0]) | (
        (keys[:, 0, 0] == keys[:, 1, 0]) & (keys[:, 0, 1] > keys[:, 1, 1])
    )
    keys[swapped] = keys[swapped, ::-1]
    _, first, shape = np.unique(keys.reshape(-1, 4), axis=0, return_index=True, return_inverse=True)
    owners = np.column_stack([shape.ravel(), np.tile(np.arange(len(wire_map)), 2)])
    ends = np.concatenate([shapes[first], nudged[len(wire_map) :]])
    return Plan(
        sight=frozen(np.dstack([ends, np.zeros((len(ends), 2, 1))])),
        walls=frozen(wire_map.walls[tall]),
        members=np.unique(owners, axis=0),
        first_wall=len(first),
        low_walls=int((~tall).sum()),
    )
