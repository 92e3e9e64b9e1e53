"""How bright a point of a facet is: the light that falls on it, and the pattern of its paint. Compiled.

Light is some of everywhere, lamps that shine down, and the sun through windows; shadows are those of the
walls around a window alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from runs.simulation.facets import Material, Mesh

Point = tuple[float, float, float]

_PLASTER, _PLANKS, _TILES = int(Material.PLASTER), int(Material.PLANKS), int(Material.TILES)
_WOOD, _BOOKS, _PANE = int(Material.WOOD), int(Material.BOOKS), int(Material.PANE)
_LAMP, _POSTER, _DOOR = int(Material.LAMP), int(Material.POSTER), int(Material.DOOR)
#: Light from everywhere, more of it from above than from below and a little more from one side.
_EVERYWHERE, _ABOVE, _ASIDE = 0.25, 0.03, 0.02
_SUN = 1.6
#: The sun's edge blurs by this share of the way from the window.
_PENUMBRA = 0.012


class Lights(NamedTuple):
    """What lights a building.

    `lamps`: (L, 4) place and power; `lamp_rows`: (R + 1,) where each region's begin. `windows`: (K, 6) those
    the sun shines through, an upper corner, the plan edge from it, the height; `window_rows` as for the lamps.
    `sun`: (3,) towards the sun.
    """

    lamps: Array
    lamp_rows: NDArray[np.int64]
    windows: Array
    window_rows: NDArray[np.int64]
    sun: Array


@njit(cache=True, nogil=True)
def irradiance(point: Point, direction: Point, facet: int, mesh: Mesh, lights: Lights) -> float:
    """Return the light that falls on a facet's point, on the side that the direction comes from."""
    planes, lamps, sun = mesh.planes, lights.lamps, lights.sun
    nx = planes[facet, 4] * planes[facet, 8] - planes[facet, 5] * planes[facet, 7]
    ny = planes[facet, 5] * planes[facet, 6] - planes[facet, 3] * planes[facet, 8]
    nz = planes[facet, 3] * planes[facet, 7] - planes[facet, 4] * planes[facet, 6]
    if nx * direction[0] + ny * direction[1] + nz * direction[2] > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    region = int(mesh.paints[facet, 6])
    total: float = _EVERYWHERE + _ABOVE * nz + _ASIDE * (0.8 * nx + 0.6 * ny)
    for lamp in range(lights.lamp_rows[region], lights.lamp_rows[region + 1]):
        dx, dy, dz = lamps[lamp, 0] - point[0], lamps[lamp, 1] - point[1], lamps[lamp, 2] - point[2]
        square = dx * dx + dy * dy + dz * dz
        facing = nx * dx + ny * dy + nz * dz
        if facing > 0.0 and dz > 0.0:
            total += lamps[lamp, 3] * facing * dz / (square * square + 0.3)
    facing = nx * sun[0] + ny * sun[1] + nz * sun[2]
    if facing > 0.0:
        for window in range(lights.window_rows[region], lights.window_rows[region + 1]):
            total += _SUN * facing * _through(point, lights.windows, window, sun)
    return total


@njit(cache=True, nogil=True)
def _through(point: Point, windows: Array, row: int, sun: Array) -> float:
    """Return how much of the sun a point sees through a window, in [0, 1]."""
    length = math.hypot(windows[row, 3], windows[row, 4])
    ax, ay = windows[row, 3] / length, windows[row, 4] / length
    # The window's plane, from inside: its normal is the edge turned by a quarter.
    towards = ay * sun[0] - ax * sun[1]
    if abs(towards) < 1e-6:
        return 0.0
    far = (ay * (windows[row, 0] - point[0]) - ax * (windows[row, 1] - point[1])) / towards
    if far <= 0.01:
        return 0.0
    u = ax * (point[0] + far * sun[0] - windows[row, 0]) + ay * (point[1] + far * sun[1] - windows[row, 1])
    v = windows[row, 2] - point[2] - far * sun[2]
    soft = 0.004 + _PENUMBRA * far
    inside = min(min(u, length - u), min(v, windows[row, 5] - v))
    seen: float = min(1.0, max(0.0, inside / soft + 0.5))
    return seen


@njit(cache=True, nogil=True)
def radiance(point: Point, facet: int, mesh: Mesh, light: float, far: float) -> float:
    """Return how bright a facet's point is, `far` metres away, under that light."""
    planes, paints = mesh.planes, mesh.paints
    x, y, z = point[0] - planes[facet, 0], point[1] - planes[facet, 1], point[2] - planes[facet, 2]
    u = x * planes[facet, 3] + y * planes[facet, 4] + z * planes[facet, 5]
    v = x * planes[facet, 6] + y * planes[facet, 7] + z * planes[facet, 8]
    material, seed = int(paints[facet, 0]), int(paints[facet, 5])
    albedo: float = paints[facet, 1]
    contrast: float = paints[facet, 2]
    width_m: float = paints[facet, 3]
    height_m: float = paints[facet, 4]
    a, b = u / width_m, v / height_m
    if material == _LAMP:
        return albedo
    if material == _PANE:
        return albedo * _outdoors(point, seed)
    if material == _PLANKS:
        pattern = _planks(a, b, seed, contrast, height_m, far)
    elif material == _TILES:
        pattern = _tiles(a, b, seed, contrast, width_m, height_m)
    elif material in (_WOOD, _DOOR):
        pattern = 1.0 + contrast * (
            _noise(a * 12.0, b * 0.7, seed) + 0.5 * _noise(a * 45.0, b * 2.0, seed + 1)
        )
        if material == _DOOR:
            pattern *= _rails(v, seed)
    elif material == _BOOKS:
        pattern = _books(a, b, seed)
    elif material == _POSTER:
        pattern = _mosaic(a, b, seed)
    else:
        pattern = 1.0 + contrast * (_noise(a, b, seed) + 0.5 * _noise(5.0 * a, 5.0 * b, seed + 1))
        pattern += 0.6 * contrast * _noise(60.0 * a, 60.0 * b, seed + 2)
    return light * albedo * pattern


@njit(cache=True, nogil=True)
def _chance(i: int, j: int, seed: int) -> float:
    """Return a number in [0, 1) that belongs to a cell of a grid."""
    value = (i * 374761393 + j * 668265263 + seed * 2246822519) & 0xFFFFFFFF
    value = ((value ^ (value >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((value ^ (value >> 16)) & 0xFFFFFF) / 16777216.0


@njit(cache=True, nogil=True)
def _noise(x: float, y: float, seed: int) -> float:
    """Return smooth noise in [-1, 1], one bump a unit."""
    i, j = math.floor(x), math.floor(y)
    s, t = x - i, y - j
    s, t = s * s * (3.0 - 2.0 * s), t * t * (3.0 - 2.0 * t)
    low = (1.0 - s) * _chance(i, j, seed) + s * _chance(i + 1, j, seed)
    high = (1.0 - s) * _chance(i, j + 1, seed) + s * _chance(i + 1, j + 1, seed)
    return 2.0 * ((1.0 - t) * low + t * high) - 1.0


@njit(cache=True, nogil=True)
def _planks(a: float, b: float, seed: int, contrast: float, width_m: float, far: float) -> float:
    """Boards along the first axis, each with a shade of its own, dark gaps between."""
    row = math.floor(b)
    along = a + 7.0 * _chance(row, 1, seed)
    board = math.floor(along)
    shade = 1.0 + contrast * (2.0 * _chance(row, board, seed + 3) - 1.0)
    shade *= 1.0 + 0.3 * contrast * _noise(along * 8.0, b * 9.0, seed + 5)
    gap = 0.0025 / width_m
    inside = b - row
    if inside < gap or (along - board) < 0.002:
        shade *= 0.55
    # Boards shine a little where they are seen from far off.
    return shade * (1.0 + 0.02 * min(far, 8.0))


@njit(cache=True, nogil=True)
def _tiles(a: float, b: float, seed: int, contrast: float, width_m: float, height_m: float) -> float:
    """Tiles with joints."""
    i, j = math.floor(a), math.floor(b)
    shade = 1.0 + 0.3 * contrast * (2.0 * _chance(i, j, seed) - 1.0)
    shade *= 1.0 + 0.2 * contrast * _noise(a * 9.0, b * 9.0, seed + 2)
    if (a - i) * width_m < 0.006 or (b - j) * height_m < 0.006:
        shade *= 1.0 - contrast
    return shade


@njit(cache=True, nogil=True)
def _rails(height_m: float, seed: int) -> float:
    """Grooves across a door."""
    for groove in range(1 + seed % 4):
        at = 0.15 + 1.7 * _chance(groove, 0, seed)
        if abs(height_m - at) < 0.008:
            return 0.6
    return 1.0


@njit(cache=True, nogil=True)
def _books(a: float, b: float, seed: int) -> float:
    """Shelves of books; the first size is that of a book's back, the second a shelf's height."""
    shelf = math.floor(b)
    inside = b - shelf
    if inside < 0.07:
        return 0.9
    book = math.floor(a)
    tall = 0.6 + 0.33 * _chance(book, shelf, seed)
    if inside > tall:
        return 0.12
    shade = 0.15 + 1.1 * _chance(book, shelf, seed + 1)
    if abs(inside - 0.75 * tall) < 0.03:
        shade = 1.4 - shade
    return shade


@njit(cache=True, nogil=True)
def _mosaic(a: float, b: float, seed: int) -> float:
    """A poster: blocks of two sizes."""
    shade = 0.25 + 1.2 * _chance(math.floor(a), math.floor(b), seed)
    if _chance(math.floor(a), math.floor(b), seed + 9) < 0.4:
        shade = 0.3 + 1.1 * _chance(math.floor(a * 1.3), math.floor(b * 9.0), seed + 4)
    return shade


@njit(cache=True, nogil=True)
def _outdoors(point: Point, seed: int) -> float:
    """What one sees through a window: a bright sky over dark, uneven green."""
    along = point[0] + point[1]
    edge = 1.15 + 0.25 * _noise(along * 2.0, 0.0, seed) + 0.15 * _noise(along * 9.0, 0.0, seed + 1)
    if point[2] > edge:
        return 1.0
    return 0.25 + 0.15 * _noise(along * 14.0, point[2] * 14.0, seed + 2)
