"""Straight lines through edge points: robust, with their moments, so that lines can be joined later."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.edgepoints import SHARPNESS, STRENGTH, X, Y

#: Columns of a fitted line: sums over its points of the weight and of x, y, xx, xy, yy, strength and
#: sharpness times the weight; first and last point on the line (ideal, then raw pixels); its direction.
W, WX, WY, WXX, WXY, WYY, WSTRENGTH, WSHARPNESS = range(8)
START, END, RAW_START, RAW_END, ALONG = 8, 10, 12, 14, 16
COLUMNS = 18
SUMS = slice(0, 8)

#: Tukey's biweight loses 5 % of the points' worth to noise, and all points beyond so many deviations; points
#: on a straight edge are not blamed for less than the second figure.
_TUKEY = 4.685
_LEAST_SCALE_PX = 0.08
#: Rounds of weighting, and the scatter above which another one is worth its time.
_ROUNDS = 3
_CLEAN_PX = 0.15
#: Points at either end of a piece that lie on the bend of the corner there, where the gradient mixes two edges.
_BEND = 2


@njit(cache=True, nogil=True)
def direction_of(line: Array) -> tuple[float, float]:
    """The direction of largest spread of a line's points, up to its sign."""
    x, y = line[WX] / line[W], line[WY] / line[W]
    xx = line[WXX] / line[W] - x * x
    xy = line[WXY] / line[W] - x * y
    yy = line[WYY] / line[W] - y * y
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return math.cos(angle), math.sin(angle)


@njit(cache=True, nogil=True)
def fit_lines(points: Array, ideal: Array, starts: NDArray[np.int32]) -> Array:
    """Fit a line to each piece by total least squares with Tukey's weights, (M, `COLUMNS`).

    `points`: (Q, 6) as measured, `ideal`: (Q, 2) the same undistorted, `starts`: (M + 1,) of the pieces.
    """
    lines = np.zeros((len(starts) - 1, COLUMNS))
    for number in range(len(lines)):
        line, first, last = lines[number], starts[number], starts[number + 1]
        bound = np.inf
        for _ in range(_ROUNDS):
            _weigh(line, points, ideal, first, last, bound)
            if line[W] == 0.0:
                break
            scale = _scatter(line, ideal, first, last)
            bound = _TUKEY * max(scale, _LEAST_SCALE_PX)
            if scale < _CLEAN_PX:
                break
        if line[W] > 0.0:
            _weigh(line, points, ideal, first, last, bound)
        if line[W] > 0.0:
            _end(line, points, ideal, first, last, bound)
    return lines


@njit(cache=True, nogil=True)
def _weigh(line: Array, points: Array, ideal: Array, first: int, last: int, bound: float) -> None:
    """Sum the points within `bound` of the line so far, weighted by their distances, and lay it anew."""
    x, y = (line[WX] / line[W], line[WY] / line[W]) if bound < np.inf else (0.0, 0.0)
    along_x, along_y, inverse = line[ALONG], line[ALONG + 1], 1.0 / bound
    w = wx = wy = wxx = wxy = wyy = strength = sharpness = 0.0
    for at in range(first + _BEND, last - _BEND):
        px, py = ideal[at, 0], ideal[at, 1]
        share = (along_x * (py - y) - along_y * (px - x)) * inverse
        rest = max(1.0 - share * share, 0.0)
        weight = rest * rest
        w += weight
        wx += weight * px
        wy += weight * py
        wxx += weight * px * px
        wxy += weight * px * py
        wyy += weight * py * py
        strength += weight * points[at, STRENGTH]
        sharpness += weight * points[at, SHARPNESS]
    line[W], line[WX], line[WY], line[WXX], line[WXY], line[WYY] = w, wx, wy, wxx, wxy, wyy
    line[WSTRENGTH], line[WSHARPNESS] = strength, sharpness
    if w > 0.0:
        along_x, along_y = direction_of(line)
        chord_x, chord_y = ideal[last - 1, 0] - ideal[first, 0], ideal[last - 1, 1] - ideal[first, 1]
        sense = 1.0 if along_x * chord_x + along_y * chord_y > 0.0 else -1.0
        line[ALONG], line[ALONG + 1] = sense * along_x, sense * along_y


@njit(cache=True, nogil=True)
def _scatter(line: Array, ideal: Array, first: int, last: int) -> float:
    """A standard deviation of the points about the line that outliers hardly move."""
    x, y = line[WX] / line[W], line[WY] / line[W]
    along_x, along_y, total = line[ALONG], line[ALONG + 1], 0.0
    for at in range(first + _BEND, last - _BEND):
        total += min(abs(along_x * (ideal[at, 1] - y) - along_y * (ideal[at, 0] - x)), 2.0)
    return 1.25 * total / (last - first - 2 * _BEND)


@njit(cache=True, nogil=True)
def _end(line: Array, points: Array, ideal: Array, first: int, last: int, bound: float) -> None:
    """Find the first and the last point on the line."""
    x, y = line[WX] / line[W], line[WY] / line[W]
    along_x, along_y = line[ALONG], line[ALONG + 1]
    start, end = first, last - 1
    while abs(along_x * (ideal[start, 1] - y) - along_y * (ideal[start, 0] - x)) > bound and start < end:
        start += 1
    while abs(along_x * (ideal[end, 1] - y) - along_y * (ideal[end, 0] - x)) > bound and start < end:
        end -= 1
    for column, raw, at in ((START, RAW_START, start), (END, RAW_END, end)):
        reach = along_x * (ideal[at, 0] - x) + along_y * (ideal[at, 1] - y)
        line[column], line[column + 1] = x + reach * along_x, y + reach * along_y
        line[raw], line[raw + 1] = points[at, X], points[at, Y]
