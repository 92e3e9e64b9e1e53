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
from maps.wiremap import WireMap

#: Edges are moved into the floor, so a wall hides whatever is behind its plane; an edge in the plane of a
#: lintel, a door's top edge, is not hidden by it.
_WALL_MARGIN_M = 1e-9
_LINTEL_MARGIN_M = 0.05
#: For lists that must not miss anything, lintels hide a little less than they do.
_LENIENT_MARGIN_M = 0.15
_LENIENT_RISE_M = 0.02
#: Shorter stretches than this share of a segment are gaps between occluders that touch.
_MIN_SPAN = 1e-6


def visible_spans(wire_map: WireMap, eye: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Return the stretches of segments that can be seen from `eye`.

    `eye`: (3,) metres, map frame. `rows`: (K,) the segments asked for.
    Returns positions in `rows` (P,) and spans (P, 2) of visible stretches, as parameters in [0, 1] from p0
    to p1; a segment seen in several stretches occurs several times, in order.
    """
    return unhidden_spans(wire_map.sight_endpoints[rows], *_shadows(wire_map, eye))


def unhidden_spans(sight: Array, planes: Array, offsets: Array) -> tuple[NDArray[np.int64], Array]:
    """Return what shadows, as from `shadows_of`, leave of segments (K, 2, 3): which (P,), and spans (P, 2)."""
    low, high = _hidden_intervals(sight, planes, offsets)
    spans = _gaps(low, high)
    which, gap = np.nonzero(spans[..., 1] - spans[..., 0] > _MIN_SPAN)
    return which, spans[which, gap]


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
            solid = shadows_of(walls, eye, _LENIENT_MARGIN_M, tops, below=True)
            hanging = shadows_of(edges, eye, _LENIENT_MARGIN_M, bottoms, below=False)
            start, end = _hidden_intervals(wire_map.sight_endpoints[rows[left]], *_joined(solid, hanging))
            hidden &= (start <= 0.0) & (end >= 1.0)
            still = hidden.any(axis=1)
            left, hidden = left[still], hidden[still]
    return np.isin(np.arange(len(rows)), left)


def _shadows(wire_map: WireMap, eye: Array) -> tuple[Array, Array]:
    """Return normals (S, 4, 3) and offsets (S, 4): a point is hidden where all normal . p > offset."""
    side = cross_plan(wire_map.walls[:, 1] - wire_map.walls[:, 0], eye[:2] - wire_map.walls[:, 0])
    # Leaving the floor means crossing a wall from its floor side, but a low obstacle can also hide
    # things behind its far side, over which the sight line came down.
    acts = (side > 0.0) | np.isfinite(wire_map.wall_tops_m)
    solid = shadows_of(wire_map.walls[acts], eye, _WALL_MARGIN_M, wire_map.wall_tops_m[acts], below=True)
    hanging = shadows_of(wire_map.lintels, eye, _LINTEL_MARGIN_M, wire_map.lintel_bottoms_m, below=False)
    return _joined(solid, hanging)


def _joined(solid: tuple[Array, Array], hanging: tuple[Array, Array]) -> tuple[Array, Array]:
    """Shadows of walls and of lintels in one; walls without tops have no fourth plane, and get an open one."""
    if solid[0].shape[1] < hanging[0].shape[1]:
        normals = np.concatenate([solid[0], np.zeros((len(solid[0]), 1, 3))], axis=1)
        solid = normals, np.concatenate([solid[1], np.full((len(solid[1]), 1), -1.0)], axis=1)
    return np.concatenate([solid[0], hanging[0]]), np.concatenate([solid[1], hanging[1]])


def shadows_of(
    edges: Array, eye: Array, margin_m: float, heights: Array, *, below: bool
) -> tuple[Array, Array]:
    """Return the shadow half-spaces of vertical rectangles on plan edges (S, 2, 2), solid below or above.

    `eye`: (3,). `heights`: (S,), infinite for walls without a top. What lies less than `margin_m` behind is not
    hidden. Normals (S, 4, 3) and offsets (S, 4): a point is hidden where all normal . p > offset. Where no wall
    has a top, the fourth plane is left out.
    """
    left = cross_plan(edges[:, 1] - edges[:, 0], eye[:2] - edges[:, 0]) >= 0.0
    a = np.where(left[:, None], edges[:, 0], edges[:, 1]) - eye[:2]
    b = np.where(left[:, None], edges[:, 1], edges[:, 0]) - eye[:2]
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1), 1e-12)[:, None]
    zero = np.zeros(len(edges))
    # Relative to the eye, for a wall seen with a on the left-hand end: inside the wedge, behind the wall.
    normals = np.stack(
        [
            np.column_stack([-a[:, 1], a[:, 0], zero]),
            np.column_stack([b[:, 1], -b[:, 0], zero]),
            np.column_stack([along[:, 1], -along[:, 0], zero]),
            np.zeros((len(edges), 3)),
        ],
        axis=1,
    )
    limits = np.zeros((len(edges), 4))
    limits[:, 2] = along[:, 1] * a[:, 0] - along[:, 0] * a[:, 1] + margin_m
    # The plane through the eye and the rectangle's horizontal edge, upwards normal.
    bounded = np.isfinite(heights)
    if below and not bounded.any():
        return normals[:, :3], (limits + normals @ eye)[:, :3]
    rise = np.where(bounded, heights - eye[2], 0.0)
    upwards = np.cross(np.column_stack([a, rise]), np.column_stack([b, rise]))
    normals[bounded, 3] = (-upwards if below else upwards)[bounded]
    limits[~bounded, 3] = -1.0 if below else np.inf
    return normals, limits + normals @ eye


def _hidden_intervals(sight: Array, normals: Array, offsets: Array) -> tuple[Array, Array]:
    """Clip segments (K, 2, 3) by each shadow: parameters low, high (K, S); empty where low >= high."""
    start, end = (
        [sight[:, end] @ normals[:, plane].T - offsets[:, plane] for plane in range(normals.shape[1])]
        for end in (0, 1)
    )
    return inside_interval(start, end)


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


def _gaps(low: Array, high: Array) -> Array:
    """Return what the union of the intervals (K, S) leaves of [0, 1]: (K, S + 1, 2), some of it empty."""
    empty = low >= high
    low, high = np.where(empty, 1.0, low), np.where(empty, 1.0, high)
    order = np.argsort(low, axis=1)
    low = np.take_along_axis(low, order, axis=1)
    reached = np.maximum.accumulate(np.take_along_axis(high, order, axis=1), axis=1)
    edge = np.zeros((len(low), 1))
    return np.stack([np.hstack([edge, reached]), np.hstack([low, edge + 1.0])], axis=2)


def cross_plan(a: Array, b: Array) -> Array:
    """Return the z component of plan vectors' cross product: (..., 2), (..., 2) -> (...)."""
    result: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
