"""The two interpretation trees (section 3.2): one for vertical edges, one for all others.

A level of a tree is a model segment, its branches the image lines that may be it, and none. A branch is cut when
its line is taken already, and in the vertical tree when it does not agree with all branches above it two by two,
or when no region is left from which the edges chosen so far appear in this order. Every path to a leaf is a
combination. No path is lost before the limit on their number, and a limit that was reached is told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.paper.binary import FIRST_LEFT, FIRST_RIGHT, VerticalPairs
from vision.paper.order import Masks
from vision.paper.unary import UnaryPairs


@dataclass(frozen=True, slots=True, eq=False)
class Combinations:
    """The list that a tree gives.

    `pairs`: (L, D) numbers of the pairs that each combination holds, first come first, then -1; `sizes`: (L,).
    `complete`: whether the whole tree was searched. The empty combination is one of them.
    """

    pairs: NDArray[np.int32]
    sizes: NDArray[np.int32]
    complete: bool

    def __len__(self) -> int:
        return len(self.sizes)


def horizontal_tree(pairs: UnaryPairs, limit: int) -> Combinations:
    """Return the combinations of the first tree: what the unary constraint left, one line a segment."""
    no_order = np.zeros((0, 0, 1), np.uint64)
    return _search(pairs.rows, pairs.lines, np.zeros((0, 0), np.int8), no_order, 0, limit)


def vertical_tree(pairs: VerticalPairs, order: Masks, edges: NDArray[np.int64], limit: int) -> Combinations:
    """Return the combinations of the second tree: none, or at least two pairs that agree two by two.

    `order`: (mv, mv, W) as `order_of_appearance` gives it for `edges` (mv,), sorted rows of the wire map.
    """
    if not len(pairs):
        return Combinations(np.zeros((1, 0), np.int32), np.zeros(1, np.int32), pairs.dropped == 0)
    level = np.searchsorted(edges, np.unique(pairs.rows))
    found = _search(pairs.rows, pairs.lines, pairs.agrees, order[np.ix_(level, level)], 2, limit)
    return Combinations(found.pairs, found.sizes, found.complete and pairs.dropped == 0)


def _search(
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    agrees: NDArray[np.int8],
    order: Masks,
    least: int,
    limit: int,
) -> Combinations:
    """Number the levels and search; `rows` (P,) are sorted."""
    starts = np.append(np.flatnonzero(np.diff(rows, prepend=-1)), len(rows)).astype(np.int64)
    found, sizes, complete = _paths(starts, lines, agrees, np.ascontiguousarray(order), least, limit)
    return Combinations(found, sizes, bool(complete))


@njit(cache=True, nogil=True)
def _paths(
    starts: NDArray[np.int64],
    lines: NDArray[np.int64],
    agrees: NDArray[np.int8],
    order: Masks,
    least: int,
    limit: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32], bool]:
    """All paths of at least `least` pairs, and the empty one: pairs (L, D), sizes (L,), and whether that is all.

    Level i chooses among the pairs starts[i] to starts[i + 1], and last of all none of them.
    """
    levels = len(starts) - 1
    count = lines.max() + 1 if len(lines) else 0
    found = np.full((64, levels), -1, np.int32)
    sizes = np.zeros(64, np.int32)
    total = 1
    taken = np.zeros(count, np.bool_)
    tried = np.zeros(levels + 1, np.int64)
    chosen = np.full(levels, -1, np.int64)
    path = np.empty(levels, np.int64)
    path_levels = np.empty(levels, np.int64)
    left = np.zeros((levels + 1, order.shape[2]), np.uint64)
    left[0, :] = ~left[0, :]
    size, level = 0, 0
    while level >= 0:
        if level == levels:
            if size > 0 and size >= least:
                if total == limit:
                    return found[:total], sizes[:total], False
                if total == len(sizes):
                    found = np.concatenate((found, np.full(found.shape, -1, np.int32)))
                    sizes = np.concatenate((sizes, np.zeros(len(sizes), np.int32)))
                for place in range(size):
                    found[total, place] = path[place]
                sizes[total] = size
                total += 1
            level -= 1
            continue
        if chosen[level] >= 0:
            taken[lines[chosen[level]]] = False
            chosen[level] = -1
            size -= 1
        pair = starts[level] + tried[level]
        tried[level] += 1
        if pair > starts[level + 1]:
            tried[level] = 0
            level -= 1
        elif pair == starts[level + 1]:
            level += 1
        elif not taken[lines[pair]] and _fits(pair, level, path, path_levels, size, agrees, order, left):
            chosen[level] = pair
            taken[lines[pair]] = True
            path[size], path_levels[size] = pair, level
            size += 1
            level += 1
    return found[:total], sizes[:total], True


@njit(cache=True, nogil=True)
def _fits(
    pair: int,
    level: int,
    path: NDArray[np.int64],
    path_levels: NDArray[np.int64],
    size: int,
    agrees: NDArray[np.int8],
    order: Masks,
    left: Masks,
) -> bool:
    """Whether a pair agrees with those on the path; fills left[size + 1], the regions that remain."""
    if len(agrees) == 0:
        return True
    left[size + 1] = left[size] & order[level, level]
    for place in range(size):
        said = agrees[path[place], pair]
        if said == 0:
            return False
        other = path_levels[place]
        for word in range(left.shape[1]):
            regions = np.uint64(0)
            if said & FIRST_LEFT:
                regions |= order[other, level, word]
            if said & FIRST_RIGHT:
                regions |= order[level, other, word]
            left[size + 1, word] &= regions
    return bool(left[size + 1].any())
