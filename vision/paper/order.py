"""The order in which vertical edges appear, region by region (appendix B).

The printed formula cannot be read without its lost figure. What is meant: sorted by bearing, and seen from
anywhere in a region, edges keep their order, since two of them can only change places on the line through both,
which bounds a region if a wall hides one from the other's far side. Free-standing edges change places inside a
region; there a couple has both orders. Which edge of a couple is on the left depends on the side of the line
through both on which the camera stands, and so on the corners of a convex region.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.regions import ViewRegions
from maps.wiremap import WireMap

#: How far a region may reach over the line through two edges, whose places are known no better.
_MARGIN_M = 0.02

Masks = NDArray[np.uint64]


def order_of_appearance(
    wire_map: WireMap, regions: ViewRegions, numbers: NDArray[np.int64], rows: NDArray[np.int64]
) -> Masks:
    """Return from which regions edge i may be seen on the left of edge k: bits (mv, mv, W), 64 to a word.

    `numbers`: the regions asked about, bit b of word w stands for numbers[64 w + b]; `rows`: (mv,) vertical
    edges. On the diagonal: the regions that see the edge at all. A couple has a region's bit in neither order
    if the region does not see both.
    """
    points = wire_map.endpoints[rows].mean(axis=1)[:, :2]
    words = max(-(-len(numbers) // 64), 1)
    masks = np.zeros((len(rows), len(rows), words), np.uint64)
    for place, number in enumerate(numbers.tolist()):
        region = regions.region(number)
        seen = np.isin(rows, region.rows)
        left = _left_from(points, region.corners) & seen[:, None] & seen[None]
        left[np.diag_indices(len(rows))] = seen
        masks[..., place // 64] |= left.astype(np.uint64) << np.uint64(place % 64)
    return masks


def _left_from(points: Array, corners: Array) -> NDArray[np.bool_]:
    """Whether point i is on the left of point k from some corner, (mv, mv)."""
    way = points[None] - points[:, None]
    length = np.maximum(np.linalg.norm(way, axis=2), 1e-9)
    offset = corners[None] - points[:, None]
    # On the right of the way from i to k, metres: (mv, mv, V).
    right: NDArray[Any] = (
        offset[:, None, :, 0] * way[..., None, 1] - offset[:, None, :, 1] * way[..., None, 0]
    )
    result: NDArray[np.bool_] = right.max(axis=2) / length >= -_MARGIN_M
    return result
