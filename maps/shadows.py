"""Shadows of vertical rectangles, and what they leave of straight segments: the compiled part of visibility."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array

#: Shorter stretches than this share of a segment are gaps between occluders that touch.
_MIN_SPAN = 1e-6


@njit(cache=True, nogil=True)
def shadows_of(edges: Array, eye: Array, margin_m: float, heights: Array, below: bool) -> tuple[Array, Array]:
    """Return the shadow half-spaces of vertical rectangles on plan edges (S, 2, 2), solid below or above.

    `eye`: (3,). `heights`: (S,), infinite for walls without a top. What lies less than `margin_m` behind is not
    hidden. Normals (S, 4, 3) and offsets (S, 4): a point is hidden where all normal . p > offset.
    """
    normals, offsets = np.zeros((len(edges), 4, 3)), np.zeros((len(edges), 4))
    for s in range(len(edges)):
        ax, ay = edges[s, 0, 0] - eye[0], edges[s, 0, 1] - eye[1]
        bx, by = edges[s, 1, 0] - eye[0], edges[s, 1, 1] - eye[1]
        if (bx - ax) * -ay - (by - ay) * -ax < 0.0:
            ax, ay, bx, by = bx, by, ax, ay
        # Relative to the eye, for a wall seen with a on the right-hand end: inside the wedge, behind the wall.
        length = max(math.hypot(bx - ax, by - ay), 1e-12)
        along_x, along_y = (bx - ax) / length, (by - ay) / length
        normals[s, 0, 0], normals[s, 0, 1] = -ay, ax
        normals[s, 1, 0], normals[s, 1, 1] = by, -bx
        normals[s, 2, 0], normals[s, 2, 1] = along_y, -along_x
        offsets[s, 2] = along_y * ax - along_x * ay + margin_m
        if math.isfinite(heights[s]):
            # The plane through the eye and the rectangle's horizontal edge, upwards normal.
            rise, sign = heights[s] - eye[2], -1.0 if below else 1.0
            normals[s, 3, 0] = sign * (ay * rise - rise * by)
            normals[s, 3, 1] = sign * (rise * bx - ax * rise)
            normals[s, 3, 2] = sign * (ax * by - ay * bx)
        else:
            offsets[s, 3] = -1.0 if below else np.inf
        for plane in range(4):
            for axis in range(3):
                offsets[s, plane] += normals[s, plane, axis] * eye[axis]
    return normals, offsets


@njit(cache=True, nogil=True)
def hidden_intervals(sight: Array, normals: Array, offsets: Array) -> tuple[Array, Array]:
    """Clip segments (K, 2, 3) by each shadow: parameters low, high (K, S); empty where low >= high."""
    low, high = np.empty((len(sight), len(normals))), np.empty((len(sight), len(normals)))
    for k in range(len(sight)):
        for s in range(len(normals)):
            low[k, s], high[k, s] = _hidden(sight[k], normals[s], offsets[s])
    return low, high


@njit(cache=True, nogil=True)
def unhidden_spans(sight: Array, normals: Array, offsets: Array) -> tuple[NDArray[np.int64], Array]:
    """Return what shadows, as from `shadows_of`, leave of segments (K, 2, 3): which (P,), and spans (P, 2)."""
    which, spans = np.empty(4 * len(sight) + 8, np.int64), np.empty((4 * len(sight) + 8, 2))
    low, high = np.empty(len(normals)), np.empty(len(normals))
    count = 0
    for k in range(len(sight)):
        hits = 0
        whole = False
        for s in range(len(normals)):
            start, end = _hidden(sight[k], normals[s], offsets[s])
            if start < end:
                low[hits], high[hits] = start, end
                hits += 1
                if start <= 0.0 and end >= 1.0:
                    whole = True
                    break
        if whole:
            continue
        reached = 0.0
        order = np.argsort(low[:hits])
        for at in range(hits + 1):
            until = low[order[at]] if at < hits else 1.0
            if until - reached > _MIN_SPAN:
                if count == len(which):
                    which = np.concatenate((which, np.empty_like(which)))
                    spans = np.concatenate((spans, np.empty_like(spans)))
                which[count] = k
                spans[count, 0], spans[count, 1] = reached, until
                count += 1
            if at < hits:
                reached = max(reached, high[order[at]])
    return which[:count].copy(), spans[:count].copy()


@njit(cache=True, nogil=True)
def _hidden(ends: Array, normals: Array, offsets: Array) -> tuple[float, float]:
    """The stretch of one segment (2, 3) inside all half-spaces of one shadow, as parameters; empty: (1, 0)."""
    low, high = 0.0, 1.0
    for plane in range(len(offsets)):
        x, y, z = normals[plane, 0], normals[plane, 1], normals[plane, 2]
        first = x * ends[0, 0] + y * ends[0, 1] + z * ends[0, 2] - offsets[plane]
        last = x * ends[1, 0] + y * ends[1, 1] + z * ends[1, 2] - offsets[plane]
        if first <= 0.0 and last <= 0.0:
            return 1.0, 0.0
        slope = last - first
        if slope > 0.0:
            low = max(low, -first / slope)
        elif slope < 0.0:
            high = min(high, -first / slope)
        if low >= high:
            return 1.0, 0.0
    return low, high
