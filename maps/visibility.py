"""Which stretches of the map's segments can be seen from a point: exact, in three dimensions.

A wall, a low obstacle's side and a lintel are vertical rectangles. The shadow that such a rectangle
throws from the eye is an intersection of half-spaces, so the hidden part of a straight segment is one
interval of its parameter, found by clipping; what remains after all occluders is what can be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap

#: An edge in the plane of a wall or lintel (a door's top edge) is not hidden by it.
_WALL_MARGIN_M = 1e-3
_LINTEL_MARGIN_M = 0.05
#: Shorter stretches than this share of a segment are gaps between occluders that touch.
_MIN_SPAN = 1e-6


def visible_spans(wire_map: WireMap, eye: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Return the stretches of segments that can be seen from `eye`.

    `eye`: (3,) metres, map frame. `rows`: (K,) the segments asked for.
    Returns positions in `rows` (P,) and spans (P, 2) of visible stretches, as parameters in [0, 1] from p0
    to p1; a segment seen in several stretches occurs several times, in order.
    """
    sight = wire_map.sight_endpoints[rows]
    planes, offsets = _shadows(wire_map, eye)
    low, high = _hidden_intervals(sight, planes, offsets)
    spans = _gaps(low, high)
    which, gap = np.nonzero(spans[..., 1] - spans[..., 0] > _MIN_SPAN)
    return which, spans[which, gap]


def _shadows(wire_map: WireMap, eye: Array) -> tuple[Array, Array]:
    """Return normals (S, 4, 3) and offsets (S, 4): a point is hidden where all normal . p > offset."""
    side = _cross(wire_map.walls[:, 1] - wire_map.walls[:, 0], eye[:2] - wire_map.walls[:, 0])
    # Leaving the floor means crossing a wall from its floor side, but a low obstacle can also hide
    # things behind its far side, over which the sight line came down.
    acts = (side > 0.0) | np.isfinite(wire_map.wall_tops_m)
    walls, tops = wire_map.walls[acts], wire_map.wall_tops_m[acts]
    solid = _rectangles(walls, eye, _WALL_MARGIN_M, tops, below=True)
    hanging = _rectangles(wire_map.lintels, eye, _LINTEL_MARGIN_M, wire_map.lintel_bottoms_m, below=False)
    return np.concatenate([solid[0], hanging[0]]), np.concatenate([solid[1], hanging[1]])


def _rectangles(
    edges: Array, eye: Array, margin_m: float, heights: Array, *, below: bool
) -> tuple[Array, Array]:
    """The shadow half-spaces of vertical rectangles on plan edges (S, 2, 2), solid below or above."""
    left = _cross(edges[:, 1] - edges[:, 0], eye[:2] - edges[:, 0]) >= 0.0
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
    rise = np.where(bounded, heights - eye[2], 0.0)
    upwards = np.cross(np.column_stack([a, rise]), np.column_stack([b, rise]))
    normals[bounded, 3] = (-upwards if below else upwards)[bounded]
    limits[~bounded, 3] = -1.0 if below else np.inf
    return normals, limits + normals @ eye


def _hidden_intervals(sight: Array, normals: Array, offsets: Array) -> tuple[Array, Array]:
    """Clip segments (K, 2, 3) by each shadow: parameters low, high (K, S); empty where low >= high."""
    planes = normals.reshape(-1, 3).T
    shape = (len(sight), *offsets.shape)
    start, end = ((sight[:, end] @ planes).reshape(shape) - offsets for end in (0, 1))
    return inside_interval(start, end)


def inside_interval(start: Array, end: Array) -> tuple[Array, Array]:
    """Return where a linear function is positive in all its components, as an interval of [0, 1].

    `start`, `end`: (..., C) its values at 0 and at 1. Returns low and high (...); empty where low >= high.
    """
    slope = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -start / slope
    low = np.where(slope > 0.0, crossing, np.where((slope == 0.0) & (start <= 0.0), 2.0, 0.0))
    high = np.where(slope < 0.0, crossing, 1.0)
    return np.clip(low.max(axis=-1), 0.0, 1.0), np.clip(high.min(axis=-1), 0.0, 1.0)


def _gaps(low: Array, high: Array) -> Array:
    """Return what the union of the intervals (K, S) leaves of [0, 1]: (K, S + 1, 2), some of it empty."""
    empty = low >= high
    low, high = np.where(empty, 1.0, low), np.where(empty, 1.0, high)
    order = np.argsort(low, axis=1)
    low = np.take_along_axis(low, order, axis=1)
    reached = np.maximum.accumulate(np.take_along_axis(high, order, axis=1), axis=1)
    edge = np.zeros((len(low), 1))
    return np.stack([np.hstack([edge, reached]), np.hstack([low, edge + 1.0])], axis=2)


def _cross(a: Array, b: Array) -> Array:
    """The z component of the plan vectors' cross product."""
    result: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
