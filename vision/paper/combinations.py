"""The list of matching hypotheses: the product of the two trees' lists (section 3.2), and its size (3.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.paper.trees import Combinations

#: Products looked at: so many for each hypothesis that may be kept, and as many besides.
_LOOKS, _MORE_LOOKS = 50, 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisList:
    """N hypotheses: a combination of each tree, (N,) each, most correspondences first.

    `possible`: all products of the two lists. `counted`: those found to hold enough correspondences, each line
    once; `complete`: whether every product was looked at and every one that counts is in the list.
    """

    horizontal: NDArray[np.int32]
    vertical: NDArray[np.int32]
    possible: int
    counted: int
    complete: bool

    def __len__(self) -> int:
        return len(self.horizontal)


def combine(
    horizontal: Combinations,
    horizontal_lines: NDArray[np.int64],
    vertical: Combinations,
    vertical_lines: NDArray[np.int64],
    least: int,
    budget: int,
) -> HypothesisList:
    """Return the products with at least `least` correspondences and no line twice, at most `budget` of them.

    `horizontal_lines`, `vertical_lines`: the image lines of the pairs that the combinations number. Should the
    budget not suffice, it goes to the hypotheses with the most correspondences.
    """
    lines = int(max(horizontal_lines.max(initial=0), vertical_lines.max(initial=0))) + 1
    uses = [
        _lines_used(list_.pairs, list_.sizes, of_pair, lines)
        for list_, of_pair in ((horizontal, horizontal_lines), (vertical, vertical_lines))
    ]
    order = [np.argsort(-list_.sizes, kind="stable") for list_ in (horizontal, vertical)]
    first, second, counted, looked_at_all = _products(
        order[0],
        order[1],
        horizontal.sizes[order[0]],
        vertical.sizes[order[1]],
        uses[0],
        uses[1],
        least,
        budget,
        _MORE_LOOKS + _LOOKS * budget,
        lines,
    )
    complete = bool(looked_at_all) and counted == len(first)
    possible = len(horizontal) * len(vertical)
    return HypothesisList(first, second, possible, int(counted), complete)


def most_hypotheses(mh: int, mv: int, n: int, nv: int) -> int:
    """Return how many combinations there are without any constraint: (n + 1)^mh (nv + 1)^mv."""
    return int((n + 1) ** mh * (nv + 1) ** mv)


def most_nodes(mh: int, mv: int, n: int, nv: int) -> int:
    """Return how many paths the two trees have together, (n + 1)^mh + (nv + 1)^mv (section 3.6)."""
    return int((n + 1) ** mh + (nv + 1) ** mv)


@njit(cache=True, nogil=True)
def _lines_used(
    pairs: NDArray[np.int32], sizes: NDArray[np.int32], of_pair: NDArray[np.int64], lines: int
) -> NDArray[np.uint64]:
    """The image lines of each combination, one bit a line, (L, words)."""
    used = np.zeros((len(sizes), (lines + 63) // 64), np.uint64)
    for row in range(len(sizes)):
        for place in range(sizes[row]):
            line = of_pair[pairs[row, place]]
            used[row, line // 64] |= np.uint64(1) << np.uint64(line % 64)
    return used


@njit(cache=True, nogil=True)
def _products(
    order_h: NDArray[np.int64],
    order_v: NDArray[np.int64],
    size_h: NDArray[np.int32],
    size_v: NDArray[np.int32],
    used_h: NDArray[np.uint64],
    used_v: NDArray[np.uint64],
    least: int,
    budget: int,
    looks: int,
    lines: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32], int, bool]:
    """Members of the products that count, in order of falling size; their number; whether all were looked at."""
    room = 1024
    first, second = np.empty(room, np.int32), np.empty(room, np.int32)
    kept, counted, looked = 0, 0, 0
    for total in range(min(size_h[0] + size_v[0], lines), least - 1, -1):
        start_v = len(size_v)
        for h in range(len(size_h)):
            # Sizes fall in both lists: the partners of the size that is missing move to the left.
            want = total - size_h[h]
            if h == 0 or size_h[h] != size_h[h - 1]:
                start_v = np.searchsorted(-size_v, -want)
            v = start_v
            while v < len(size_v) and size_v[v] == want:
                looked += 1
                if looked > looks:
                    return first[:kept], second[:kept], counted, False
                clear = True
                for word in range(used_h.shape[1]):
                    if used_h[order_h[h], word] & used_v[order_v[v], word]:
                        clear = False
                        break
                if clear:
                    counted += 1
                    if kept < budget:
                        if kept == room:
                            first = np.concatenate((first, np.empty(room, np.int32)))
                            second = np.concatenate((second, np.empty(room, np.int32)))
                            room *= 2
                        first[kept], second[kept] = order_h[h], order_v[v]
                        kept += 1
                v += 1
    return first[:kept], second[:kept], counted, True
