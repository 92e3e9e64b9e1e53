"""Chains of edge points cut into straight pieces."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array


@njit(cache=True, nogil=True)
def split_chains(
    points: Array, starts: NDArray[np.int32], tolerance_px: float, least_px: float
) -> NDArray[np.int32]:
    """Cut chains where they leave their chords by more than a tolerance (Ramer 1972, Douglas, Peucker 1973).

    `points`: (Q, 2) ideal pixels; `starts`: (C + 1,). Returns the first and the last point of each piece
    whose chord is at least `least_px` long, (M, 2).
    """
    pieces = np.empty((len(points), 2), np.int32)
    count = 0
    waiting = np.empty((len(points) + 1, 2), np.int32)
    for chain in range(len(starts) - 1):
        waiting[0, 0], waiting[0, 1] = starts[chain], starts[chain + 1] - 1
        depth = 1
        while depth > 0:
            depth -= 1
            first, last = waiting[depth, 0], waiting[depth, 1]
            x, y = points[first, 0], points[first, 1]
            along_x, along_y = points[last, 0] - x, points[last, 1] - y
            length = np.sqrt(along_x * along_x + along_y * along_y)
            if last - first + 1 < 0.7 * least_px or length == 0.0:
                continue
            farthest, corner = 0.0, first
            for at in range(first + 1, last):
                off = abs(along_x * (points[at, 1] - y) - along_y * (points[at, 0] - x))
                if off > farthest:
                    farthest, corner = off, at
            if farthest > tolerance_px * length:
                waiting[depth, 0], waiting[depth, 1] = corner, last
                waiting[depth + 1, 0], waiting[depth + 1, 1] = first, corner
                depth += 2
            elif length >= least_px:
                pieces[count, 0], pieces[count, 1] = first, last
                count += 1
    return pieces[:count]


def members_of(pieces: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The points of all pieces (M, 2), one after the other, and where each starts, (M + 1,)."""
    counts = pieces[:, 1] - pieces[:, 0] + 1
    starts = np.concatenate([[0], np.cumsum(counts)])
    members = np.arange(starts[-1]) + np.repeat(pieces[:, 0] - starts[:-1], counts)
    return members, starts.astype(np.int32)
