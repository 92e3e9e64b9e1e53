"""Which wall plane each segment of a map belongs to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from maps.poses import Array
from maps.wiremap import WireMap
from runs.simulation.layers import PlaneLine
from runs.simulation.walls import Region, WallPlane

#: How far behind and before a wall its segments can be, and how far beyond its ends.
_BEHIND_M, _BEFORE_M, _BEYOND_M = 0.35, 0.30, 0.15
#: A segment leans by less than this against its plane.
_LEAN_M = 0.003
#: What a metre beyond the wall's end counts against a metre before it.
_BEYOND_COST = 4.0
_TOUCH_M = 2e-3


def assign(
    wire_map: WireMap, regions: tuple[Region, ...], planes: tuple[WallPlane, ...]
) -> tuple[dict[int, list[PlaneLine]], NDArray[np.int64]]:
    """Return the lines of each plane, and the rows of the segments that no wall has.

    Level and sloping segments go to the plane that is nearest; upright ones, which are parallel to every
    wall, rather where a level one that they touch has gone.
    """
    count = len(wire_map)
    cost = np.full((len(planes), count), np.inf)
    for number, plane in enumerate(planes):
        rows = regions[plane.region].rows
        cost[number, rows] = _cost(plane, wire_map.endpoints[rows])
    plan = np.ptp(wire_map.endpoints[:, :, :2], axis=1)
    standing = np.hypot(*plan.T) < _LEAN_M
    chosen = np.where(np.isfinite(cost.min(axis=0)), cost.argmin(axis=0), -1)
    ends = KDTree(wire_map.endpoints.reshape(-1, 3))
    for row in np.flatnonzero(standing):
        near = [
            end // 2 for found in ends.query_ball_point(wire_map.endpoints[row], _TOUCH_M) for end in found
        ]
        touching = np.array([other for other in near if not standing[other] and chosen[other] >= 0], np.int64)
        votes = chosen[touching][np.isfinite(cost[chosen[touching], row])]
        if len(votes):
            chosen[row] = np.bincount(votes).argmax()
    lines: dict[int, list[PlaneLine]] = {}
    for row in np.flatnonzero(chosen >= 0):
        plane = planes[chosen[row]]
        u, z, out = plane.flat(wire_map.endpoints[row])
        lines.setdefault(int(chosen[row]), []).append(
            PlaneLine(np.column_stack([u, z]), float(out.mean()), wire_map.kinds[row])
        )
    return lines, np.flatnonzero(chosen < 0)


def _cost(plane: WallPlane, endpoints: Array) -> Array:
    """Return how badly segments (K, 2, 3) suit a plane, (K,); infinite where they do not."""
    u, z, out = plane.flat(endpoints)
    low_u, _, high_u, _ = plane.solid.bounds
    beyond = np.maximum(0.0, np.maximum(low_u - u, u - high_u)).max(axis=1)
    middle = out.mean(axis=1)
    fits = (np.ptp(out, axis=1) < _LEAN_M) & (middle > -_BEHIND_M) & (middle < _BEFORE_M)
    fits &= (beyond < _BEYOND_M) & (z.max(axis=1) < plane.ceiling_m + _TOUCH_M)
    # What lies behind a wall is seen through an opening in it, never past its end.
    fits &= (middle > -_LEAN_M) | (beyond == 0.0)
    return np.where(fits, np.abs(middle) + _BEYOND_COST * beyond, np.inf)
