"""Edge pixels linked into chains, and where in each of their pixels the edge is.

The loops over pixels are compiled. A pixel is told by its cell, y * W + x.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.gradient import GAIN

#: Columns of a measured edge point: raw pixel, unit normal towards the brighter side, strength (gradient
#: along the normal, grey levels per pixel), sharpness (1 / variance of the edge's profile, per square pixel).
X, Y, NX, NY, STRENGTH, SHARPNESS = range(6)
COLUMNS = 6

#: Squared cosine of the largest turn from one pixel of a chain to the next.
_SMOOTH = np.float32(0.6)
#: Share of an edge's strength that its profile has left a pixel away, at least.
_LITTLE = np.float32(0.01)

Slopes = NDArray[np.int16]
Cells = NDArray[np.int32]
#: (H, W): 0 no edge, or one that belongs to a chain already, 1 an edge pixel, 2 one that can start a chain.
Marks = NDArray[np.uint8]


@njit(cache=True, nogil=True)
def mark_edges(dx: Slopes, dy: Slopes, low: float, high: float) -> tuple[Marks, Cells]:
    """Mark where the gradient is above `low` and peaks along the axis nearest to its direction (Canny 1986).

    Returns the marks (H, W) and the cells of those above `high`, from which chains start.
    """
    height, width = dx.shape
    marks = np.zeros((height, width), np.uint8)
    seeds = np.empty(height * width, np.int32)
    squares = np.empty(width, np.int32)
    least, much = np.int32(min((low * GAIN) ** 2, 2e9)), np.int32(min((high * GAIN) ** 2, 2e9))
    count = 0
    for y in range(2, height - 2):
        for x in range(width):
            squares[x] = np.int32(dx[y, x]) * np.int32(dx[y, x]) + np.int32(dy[y, x]) * np.int32(dy[y, x])
        for x in range(2, width - 2):
            square = squares[x]
            if square <= least:
                continue
            gx, gy = np.int32(dx[y, x]), np.int32(dy[y, x])
            if abs(gx) >= abs(gy):
                before = gx * np.int32(dx[y, x - 1]) + gy * np.int32(dy[y, x - 1])
                after = gx * np.int32(dx[y, x + 1]) + gy * np.int32(dy[y, x + 1])
            else:
                before = gx * np.int32(dx[y - 1, x]) + gy * np.int32(dy[y - 1, x])
                after = gx * np.int32(dx[y + 1, x]) + gy * np.int32(dy[y + 1, x])
            if before >= square or after > square:
                continue
            marks[y, x] = 1
            if square > much:
                marks[y, x] = 2
                seeds[count] = y * width + x
                count += 1
    return marks, seeds[:count]


@njit(cache=True, nogil=True)
def _next(cell: int, sense: int, width: int, dx: Slopes, dy: Slopes, marks: Marks) -> int:
    """The free edge pixel that continues the edge in the next row or column; -1 where there is none.

    Of several the one whose gradient is most like this one's. The arrays are flat, (H * W,).
    """
    gx, gy = np.float32(dx[cell]), np.float32(dy[cell])
    if abs(gx) >= abs(gy):
        ahead, aside = (sense if gx < 0 else -sense) * width, 1
    else:
        ahead, aside = sense if gy > 0 else -sense, width
    least = _SMOOTH * (gx * gx + gy * gy)
    best, most = -1, np.float32(0.0)
    for other in (cell + ahead - aside, cell + ahead, cell + ahead + aside):
        if marks[other] == 0:
            continue
        ox, oy = np.float32(dx[other]), np.float32(dy[other])
        alike = gx * ox + gy * oy
        if alike > most and alike * alike >= least * (ox * ox + oy * oy):
            best, most = other, alike
    return best


@njit(cache=True, nogil=True)
def link_edges(dx: Slopes, dy: Slopes, marks: Marks, seeds: Cells, least: int) -> tuple[Cells, Cells]:
    """Link edge pixels into chains along the edge, the brighter side on the right; drop the short ones.

    `least`: pixels of a chain that is kept. Uses up the marks. Returns cells in the order of the chains
    (Q,), and where each of the C chains starts, (C + 1,).
    """
    width = marks.shape[1]
    slopes_x, slopes_y, free = dx.ravel(), dy.ravel(), marks.ravel()
    # All pixels can be edge pixels; what is not used of the room costs nothing.
    room = marks.size
    order, back = np.empty(room, np.int32), np.empty(room, np.int32)
    starts = np.zeros(room // least + 2, np.int32)
    count, chains = 0, 0
    for seed in seeds:
        if free[seed] == 0:
            continue
        free[seed] = 0
        behind = 0
        cell = _next(seed, -1, width, slopes_x, slopes_y, free)
        while cell >= 0:
            free[cell] = 0
            back[behind] = cell
            behind += 1
            cell = _next(cell, -1, width, slopes_x, slopes_y, free)
        end = count + behind
        order[count:end] = back[:behind][::-1]
        cell = int(seed)
        while cell >= 0:
            free[cell] = 0
            order[end] = cell
            end += 1
            cell = _next(cell, 1, width, slopes_x, slopes_y, free)
        if end - count >= least:
            count = end
            chains += 1
            starts[chains] = count
    return order[:count], starts[: chains + 1]


@njit(cache=True, nogil=True)
def measure_points(dx: Slopes, dy: Slopes, cells: Cells) -> Array:
    """Measure edge pixels (Q,) to a fraction of a pixel, (Q, 6).

    An edge blurred by a Gaussian has a Gaussian profile along each row and column that it crosses, so a
    parabola through the logarithms of three samples has its vertex at the edge, wherever between two pixels
    that is.
    """
    width = dx.shape[1]
    points = np.empty((len(cells), COLUMNS))
    for row, cell in enumerate(cells):
        y, x = cell // width, cell % width
        gx, gy = np.float32(dx[y, x]), np.float32(dy[y, x])
        square = gx * gx + gy * gy
        magnitude = math.sqrt(square)
        steep = abs(gx) >= abs(gy)
        along_x, along_y = (1, 0) if steep else (0, 1)
        before = gx * dx[y - along_y, x - along_x] + gy * dy[y - along_y, x - along_x]
        after = gx * dx[y + along_y, x + along_x] + gy * dy[y + along_y, x + along_x]
        # Where nothing is left on one side the profile is no Gaussian; that little bounds the logarithm.
        left = math.log(max(before / square, _LITTLE))
        right = math.log(max(after / square, _LITTLE))
        curvature = -(left + right)
        away = 0.5 * (right - left) / curvature
        across = (gx if steep else gy) / magnitude
        points[row, X] = x + along_x * away
        points[row, Y] = y + along_y * away
        points[row, NX] = gx / magnitude
        points[row, NY] = gy / magnitude
        points[row, STRENGTH] = magnitude * (1.0 + 0.5 * curvature * away * away) / GAIN
        points[row, SHARPNESS] = curvature / (across * across)
    return points


@njit(cache=True, nogil=True)
def pixels_of(cells: Cells, width: int) -> Array:
    """Return the pixels (Q, 2), x and y, of cells (Q,)."""
    pixels = np.empty((len(cells), 2))
    for row, cell in enumerate(cells):
        pixels[row, 0], pixels[row, 1] = cell % width, cell // width
    return pixels
