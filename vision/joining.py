"""Collinear fragments of one edge joined, where the image shows the edge between them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.poses import Array
from vision.edgepoints import Slopes
from vision.gradient import GAIN
from vision.linefit import ALONG, END, RAW_END, RAW_START, START, SUMS, WSTRENGTH, WX, WY, W, direction_of

#: Fragments may overlap by so much, and turn by so much (cosine) from one to the next.
_OVERLAP_PX = 4.0
_STRAIGHT = 0.985
#: A continuation starts this close beside its line, and by so much more per pixel of the gap.
_BESIDE_PX, _TURN = 2.0, 0.1
#: Neither fragment may end farther than this from the line through both.
_ASIDE_PX = 0.8
#: Share of the weaker fragment's strength that the gap must show.
_SHOWN = 0.35


@njit(cache=True, nogil=True)
def join_lines(lines: Array, dx: Slopes, dy: Slopes, gap_px: float) -> Array:
    """Join each line with those that continue it within `gap_px`, the nearest first; (N, COLUMNS), N <= M.

    A gap is bridged where the gradient in it, across the line, is a good part of the weaker line's.
    """
    # In the order of their rows, so that few need to be looked at.
    lines = lines[np.argsort(lines[:, START + 1])]
    starts_x, starts_y = lines[:, START].copy(), lines[:, START + 1].copy()
    for number in range(len(lines)):
        while starts_x[number] < np.inf:
            other = _continuation(number, lines, starts_x, starts_y, dx, dy, gap_px)
            if other < 0:
                break
            lines[number] = _joint(lines[number], lines[other])
            starts_x[other] = np.inf
    return lines[starts_x < np.inf]


@njit(cache=True, nogil=True)
def _continuation(
    number: int, lines: Array, starts_x: Array, starts_y: Array, dx: Slopes, dy: Slopes, gap_px: float
) -> int:
    """The nearest line that continues this one; -1 for none. Lines that are gone start at infinity."""
    line = lines[number]
    along_x, along_y, end_x, end_y = line[ALONG], line[ALONG + 1], line[END], line[END + 1]
    best, nearest = -1, gap_px
    # The rows in which a continuation can start.
    aside = abs(along_x) * (_TURN * gap_px + _BESIDE_PX)
    low = min(gap_px * along_y, -_OVERLAP_PX * along_y) - aside
    high = max(gap_px * along_y, -_OVERLAP_PX * along_y) + aside
    for other in range(np.searchsorted(starts_y, end_y + low), len(lines)):
        x, y = starts_x[other] - end_x, starts_y[other] - end_y
        if y > min(nearest, high):
            break
        if abs(x) > nearest:
            continue
        gap = along_x * x + along_y * y
        if not -_OVERLAP_PX <= gap < nearest or abs(along_x * y - along_y * x) > _TURN * gap + _BESIDE_PX:
            continue
        if along_x * lines[other, ALONG] + along_y * lines[other, ALONG + 1] < _STRAIGHT or other == number:
            continue
        if _shown(line, lines[other], dx, dy) and _aligned(line, lines[other]):
            best, nearest = other, max(gap, _OVERLAP_PX)
    return best


@njit(cache=True, nogil=True)
def _joint(line: Array, other: Array) -> Array:
    """The line through the points of both."""
    joint = line.copy()
    joint[SUMS] += other[SUMS]
    along_x, along_y = direction_of(joint)
    if along_x * line[ALONG] + along_y * line[ALONG + 1] < 0.0:
        along_x, along_y = -along_x, -along_y
    joint[ALONG], joint[ALONG + 1] = along_x, along_y
    joint[RAW_END], joint[RAW_END + 1] = other[RAW_END], other[RAW_END + 1]
    x, y = joint[WX] / joint[W], joint[WY] / joint[W]
    for column, end_x, end_y in (
        (START, line[START], line[START + 1]),
        (END, other[END], other[END + 1]),
    ):
        reach = along_x * (end_x - x) + along_y * (end_y - y)
        joint[column], joint[column + 1] = x + reach * along_x, y + reach * along_y
    return joint


@njit(cache=True, nogil=True)
def _aligned(line: Array, other: Array) -> bool:
    """Whether all four ends lie on the line through both."""
    joint = _joint(line, other)
    x, y = joint[WX] / joint[W], joint[WY] / joint[W]
    for ends in (line, other):
        for column in (START, END):
            off = joint[ALONG] * (ends[column + 1] - y) - joint[ALONG + 1] * (ends[column] - x)
            if abs(off) > _ASIDE_PX:
                return False
    return True


@njit(cache=True, nogil=True)
def _shown(line: Array, other: Array, dx: Slopes, dy: Slopes) -> bool:
    """Whether the edge can be seen in the raw image between two lines."""
    height, width = dx.shape
    x, y = line[RAW_END], line[RAW_END + 1]
    along_x, along_y = other[RAW_START] - x, other[RAW_START + 1] - y
    length = math.hypot(along_x, along_y)
    if length < 2.0:
        return True
    steps = int(length)
    across_x, across_y = -along_y / length, along_x / length
    if across_x * -line[ALONG + 1] + across_y * line[ALONG] < 0.0:
        across_x, across_y = -across_x, -across_y
    total = 0.0
    for step in range(1, steps):
        column, row = x + along_x * step / steps, y + along_y * step / steps
        strongest = -np.inf
        for aside in range(-1, 2):
            j = min(max(round(column + aside * across_x), 0), width - 1)
            i = min(max(round(row + aside * across_y), 0), height - 1)
            strongest = max(strongest, across_x * dx[i, j] + across_y * dy[i, j])
        total += strongest
    weaker = min(line[WSTRENGTH] / line[W], other[WSTRENGTH] / other[W])
    return bool(total >= _SHOWN * weaker * GAIN * max(steps - 1, 1))
