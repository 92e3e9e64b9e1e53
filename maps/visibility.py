"""Which stretches of the map's segments can be seen from a point: exact, in three dimensions.

A wall, a low obstacle's side and a lintel are vertical rectangles. The shadow that such a rectangle
throws from the eye is an intersection of half-spaces, so the hidden part of a straight segment is one
interval of its parameter, found by clipping; what remains after all occluders is what can be seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.shadows import hidden_intervals, shadows_of, unhidden_spans
from maps.wiremap import WireMap

#: Edges are moved into the floor, so a wall hides whatever is behind its plane; an edge in the plane of a
#: lintel, a door's top edge, is not hidden by it.
_WALL_MARGIN_M = 1e-9
_LINTEL_MARGIN_M = 0.05
#: For lists that must not miss anything, lintels hide a little less than they do.
_LENIENT_MARGIN_M = 0.15
_LENIENT_RISE_M = 0.02


def visible_spans(wire_map: WireMap, eye: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Return the stretches of segments that can be seen from `eye`.

    `eye`: (3,) metres, map frame. `rows`: (K,) the segments asked for.
    Returns positions in `rows` (P,) and spans (P, 2) of visible stretches, as parameters in [0, 1] from p0
    to p1; a segment seen in several stretches occurs several times, in order.
    """
    return unhidden_spans(wire_map.sight_endpoints[rows], *shadows_from(wire_map, eye))


def hidden_by_heights(
    wire_map: WireMap,
    corners: Array,
    heights_m: tuple[float, float],
    rows: NDArray[np.int64],
    low_walls: NDArray[np.int64],
    lintels: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return which segments one lintel, or one side of a low obstacle, hides from a whole convex cell.

    `corners`: (V, 2) of the cell; eyes between two heights; `rows`: (K,); `low_walls`, `lintels`: the numbers of
    those to consider. The eyes from which a convex occluder hides a whole segment are a convex set, so what it
    hides from the corners it hides from everything between.
    """
    low = np.flatnonzero(np.isfinite(wire_map.wall_tops_m))[low_walls]
    walls, tops = wire_map.walls[low], wire_map.wall_tops_m[low] - _LENIENT_RISE_M
    edges, bottoms = wire_map.lintels[lintels], wire_map.lintel_bottoms_m[lintels] + _LENIENT_RISE_M
    left = np.arange(len(rows))
    hidden = np.ones((len(rows), len(walls) + len(edges)), bool)
    for height in sorted(set(heights_m)):
        for corner in corners:
            eye = np.append(corner, height)
            solid = shadows_of(walls, eye, _LENIENT_MARGIN_M, tops, True)
            hanging = shadows_of(edges, eye, _LENIENT_MARGIN_M, bottoms, False)
            start, end = hidden_intervals(wire_map.sight_endpoints[rows[left]], *_joined(solid, hanging))
            hidden &= (start <= 0.0) & (end >= 1.0)
            still = hidden.any(axis=1)
            left, hidden = left[still], hidden[still]
    return np.isin(np.arange(len(rows)), left)


def shadows_from(wire_map: WireMap, eye: Array) -> tuple[Array, Array]:
    """Return normals (S, 4, 3) and offsets (S, 4): a point is hidden where all normal . p > offset."""
    side = cross_plan(wire_map.walls[:, 1] - wire_map.walls[:, 0], eye[:2] - wire_map.walls[:, 0])
    # Leaving the floor means crossing a wall from its floor side, but a low obstacle can also hide
    # things behind its far side, over which the sight line came down.
    acts = (side > 0.0) | np.isfinite(wire_map.wall_tops_m)
    solid = shadows_of(wire_map.walls[acts], eye, _WALL_MARGIN_M, wire_map.wall_tops_m[acts], True)
    hanging = shadows_of(wire_map.lintels, eye, _LINTEL_MARGIN_M, wire_map.lintel_bottoms_m, False)
    return _joined(solid, hanging)


def _joined(solid: tuple[Array, Array], hanging: tuple[Array, Array]) -> tuple[Array, Array]:
    """Shadows of walls and of lintels in one."""
    return np.concatenate([solid[0], hanging[0]]), np.concatenate([solid[1], hanging[1]])


def inside_interval(start: Sequence[Array], end: Sequence[Array]) -> tuple[Array, Array]:
    """Return where linear functions are positive all at once, as an interval of [0, 1].

    `start`, `end`: their values at 0 and at 1, one array (...) a function. Returns low and high (...); empty
    where low >= high.
    """
    low, high = np.zeros_like(start[0]), np.ones_like(start[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        for first, last in zip(start, end, strict=True):
            slope = last - first
            crossing = -first / slope
            low = np.maximum(low, np.where(slope > 0.0, crossing, 0.0))
            high = np.minimum(high, np.where(slope < 0.0, crossing, 1.0))
            high = np.where((slope == 0.0) & (first <= 0.0), -1.0, high)
    return np.minimum(low, 1.0), np.maximum(high, 0.0)


def cross_plan(a: Array, b: Array) -> Array:
    """Return the z component of plan vectors' cross product: (..., 2), (..., 2) -> (...)."""
    result: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
