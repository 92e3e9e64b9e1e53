"""The distance of a viewed segment from a projected one, equation (7), as meant and as printed.

The text wants the mean distance of one segment's points from the other segment. The printed integral runs over
the abscissa along the projected segment and is divided by that segment's length: a viewed segment perpendicular
to the projected one is then at no distance at all, however far away. The mean over the viewed segment's own
length is what is meant; both follow from the same integral.
"""

from __future__ import annotations

import math
from enum import StrEnum

from numba import njit


class SegmentDistance(StrEnum):
    """Which reading of equation (7)."""

    #: Mean distance over the viewed segment.
    MEAN = "mean"
    #: As printed.
    PRINTED = "printed"


@njit(cache=True, nogil=True)
def mean_distance(
    px: float, py: float, qx: float, qy: float, sx: float, sy: float, ex: float, ey: float
) -> float:
    """Return the mean distance in pixels of the points of the viewed segment s-e from the projected one p-q."""
    length = math.sqrt((ex - sx) ** 2 + (ey - sy) ** 2)
    if length < 1e-9:
        return distance_integral(px, py, qx, qy, sx, sy, sx + 1e-6, sy) / 1e-6
    return distance_integral(px, py, qx, qy, sx, sy, ex, ey) / length


@njit(cache=True, nogil=True)
def printed_distance(
    px: float, py: float, qx: float, qy: float, sx: float, sy: float, ex: float, ey: float
) -> float:
    """Return equation (7) as printed: the integral over the abscissa along p-q, over the length of p-q."""
    base = math.sqrt((qx - px) ** 2 + (qy - py) ** 2)
    length = math.sqrt((ex - sx) ** 2 + (ey - sy) ** 2)
    if base < 1e-9 or length < 1e-9:
        return 0.0
    lean = abs((ex - sx) * (qx - px) + (ey - sy) * (qy - py)) / (base * length)
    return lean * distance_integral(px, py, qx, qy, sx, sy, ex, ey) / base


@njit(cache=True, nogil=True)
def distance_integral(
    px: float, py: float, qx: float, qy: float, sx: float, sy: float, ex: float, ey: float
) -> float:
    """Return the integral along s-e of the distance from the segment p-q, pixels squared, in closed form.

    Split at the perpendiculars on the ends of p-q: between them the distance is that from the line, outside that
    from an end.
    """
    length = math.sqrt((ex - sx) ** 2 + (ey - sy) ** 2)
    base = math.sqrt((qx - px) ** 2 + (qy - py) ** 2)
    ux, uy = (ex - sx) / length, (ey - sy) / length
    if base < 1e-9:
        return _from_point(px, py, sx, sy, ux, uy, 0.0, length)
    bx, by = (qx - px) / base, (qy - py) / base
    x, y = (sx - px) * bx + (sy - py) * by, (sy - py) * bx - (sx - px) * by
    along, across = ux * bx + uy * by, uy * bx - ux * by
    if abs(along) < 1e-12:
        if x <= 0.0:
            return _from_point(px, py, sx, sy, ux, uy, 0.0, length)
        if x >= base:
            return _from_point(qx, qy, sx, sy, ux, uy, 0.0, length)
        return _from_line(y, y + length * across, length)
    # Where the abscissa passes 0 and where the other end of p-q.
    at_p, at_q = min(max(-x / along, 0.0), length), min(max((base - x) / along, 0.0), length)
    if along > 0.0:
        total = _from_point(px, py, sx, sy, ux, uy, 0.0, at_p)
        total += _from_line(y + at_p * across, y + at_q * across, at_q - at_p)
        return total + _from_point(qx, qy, sx, sy, ux, uy, at_q, length)
    total = _from_point(qx, qy, sx, sy, ux, uy, 0.0, at_q)
    total += _from_line(y + at_q * across, y + at_p * across, at_p - at_q)
    return total + _from_point(px, py, sx, sy, ux, uy, at_p, length)


@njit(cache=True, nogil=True)
def _from_line(y1: float, y2: float, length: float) -> float:
    """The integral of |y| over a stretch along which y goes from y1 to y2."""
    if y1 * y2 >= 0.0:
        return 0.5 * abs(y1 + y2) * length
    return 0.5 * (y1 * y1 + y2 * y2) / abs(y2 - y1) * length


@njit(cache=True, nogil=True)
def _from_point(
    x: float, y: float, sx: float, sy: float, ux: float, uy: float, low: float, high: float
) -> float:
    """The integral of the distance from (x, y) along s + t u, t from low to high."""
    if high <= low:
        return 0.0
    foot = (x - sx) * ux + (y - sy) * uy
    height = abs((x - sx) * uy - (y - sy) * ux)
    return _root_integral(high - foot, height) - _root_integral(low - foot, height)


@njit(cache=True, nogil=True)
def _root_integral(t: float, height: float) -> float:
    """The antiderivative of sqrt(t^2 + height^2), 0 at t = 0."""
    if height < 1e-12:
        return 0.5 * t * abs(t)
    return 0.5 * (t * math.sqrt(t * t + height * height) + height * height * math.asinh(t / height))
