"""Rays through a mesh: a picture's radiance, several rays a pixel, each at its own moment of the exposure.

Compiled. What a tile of the picture could show is listed once, the nearest first; its rays go down that list.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from runs.simulation.facets import Mesh
from runs.simulation.shading import Lights, irradiance, radiance
from runs.simulation.tiles import TILE_PX, candidates, tile_bounds

_FAR = 1e9


@njit(cache=True, nogil=True)
def cast_picture(
    rays: Array, rotations: Array, centres: Array, mesh: Mesh, lights: Lights, seed: int
) -> Array:
    """Return the mean radiance of each pixel, (H, W).

    `rays`: (H + 1, W + 1, 2) normalised image coordinates of the pixels' corners. `rotations` (S, 3, 3),
    `centres` (S, 3): map_from_optical at the moments of the S rays that each pixel gets.
    """
    height, width = rays.shape[0] - 1, rays.shape[1] - 1
    picture = np.zeros((height, width))
    rows, depths = np.empty(len(mesh.triangles), np.int64), np.empty(len(mesh.triangles))
    for top in range(0, height, TILE_PX):
        for left in range(0, width, TILE_PX):
            bottom, right = min(top + TILE_PX, height), min(left + TILE_PX, width)
            bounds, margin_m = tile_bounds(rays, rotations, centres, top, left, bottom, right)
            count = candidates(rotations[0], centres[0], bounds, margin_m, mesh, rows, depths)
            order = np.argsort(depths[:count])
            near, front = rows[:count][order], depths[:count][order] - margin_m
            tile = top, left, bottom, right
            _draw_tile(picture, tile, seed, rays, rotations, centres, near, front, mesh, lights)
    return picture


@njit(cache=True, nogil=True)
def _draw_tile(
    picture: Array,
    tile: tuple[int, int, int, int],
    seed: int,
    rays: Array,
    rotations: Array,
    centres: Array,
    near: NDArray[np.int64],
    front: Array,
    mesh: Mesh,
    lights: Lights,
) -> None:
    """Draw the pixels of a tile (top, left, bottom, right) from triangles `near` with least depths `front`.

    A pixel's rays are spread by the plastic number's sequence, from a start of its own. A function for each
    pixel would spend longer on handing over its arguments than on its rays.
    """
    samples = len(centres)
    for row in range(tile[0], tile[2]):
        for column in range(tile[1], tile[3]):
            start = _mixed(row * picture.shape[1] + column + seed * 7919)
            total, light, lit, hits = 0.0, 0.0, -1, 0
            for sample in range(samples):
                x = ((start & 0xFFFF) / 65536.0 + 0.7548776662466927 * sample) % 1.0
                y = (((start >> 16) & 0xFFFF) / 65536.0 + 0.5698402909980532 * sample) % 1.0
                a, b = _inside(rays, row, column, 0, x, y), _inside(rays, row, column, 1, x, y)
                dx = rotations[sample, 0, 0] * a + rotations[sample, 0, 1] * b + rotations[sample, 0, 2]
                dy = rotations[sample, 1, 0] * a + rotations[sample, 1, 1] * b + rotations[sample, 1, 2]
                dz = rotations[sample, 2, 0] * a + rotations[sample, 2, 1] * b + rotations[sample, 2, 2]
                cx, cy, cz = centres[sample, 0], centres[sample, 1], centres[sample, 2]
                hit, far = -1, _FAR
                for place in range(len(near)):
                    if front[place] >= far:
                        break
                    here = _crossing(cx, cy, cz, dx, dy, dz, mesh.triangles, near[place])
                    if here < far:
                        hit, far = near[place], here
                if hit < 0:
                    continue
                facet = mesh.facet_of[hit]
                point = cx + far * dx, cy + far * dy, cz + far * dz
                if facet != lit:
                    # Light changes slowly: once a pixel and facet is enough.
                    light, lit = irradiance(point, (dx, dy, dz), facet, mesh, lights), facet
                total += radiance(point, facet, mesh, light, far)
                hits += 1
            # A ray that rounding lets through between two triangles counts for nothing.
            picture[row, column] = total / max(hits, 1)


@njit(cache=True, nogil=True)
def _inside(rays: Array, row: int, column: int, axis: int, x: float, y: float) -> float:
    """Return a coordinate of a place inside a pixel, (x, y) in [0, 1], from its corners'."""
    upper = (1.0 - x) * rays[row, column, axis] + x * rays[row, column + 1, axis]
    lower = (1.0 - x) * rays[row + 1, column, axis] + x * rays[row + 1, column + 1, axis]
    inside: float = (1.0 - y) * upper + y * lower
    return inside


@njit(cache=True, nogil=True)
def _mixed(number: int) -> int:
    """Return 32 bits that look random."""
    value = (number * 747796405 + 2891336453) & 0xFFFFFFFF
    value = ((value >> ((value >> 28) + 4)) ^ value) * 277803737 & 0xFFFFFFFF
    return ((value >> 22) ^ value) & 0xFFFFFFFF


@njit(cache=True, nogil=True)
def _crossing(
    x: float, y: float, z: float, dx: float, dy: float, dz: float, triangles: Array, row: int
) -> float:
    """Return where a ray crosses a triangle (Moeller and Trumbore 1997); the far limit where it does not."""
    e1x, e1y, e1z = triangles[row, 3], triangles[row, 4], triangles[row, 5]
    e2x, e2y, e2z = triangles[row, 6], triangles[row, 7], triangles[row, 8]
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    det = e1x * px + e1y * py + e1z * pz
    if -1e-15 < det < 1e-15:
        return _FAR
    inv = 1.0 / det
    tx, ty, tz = x - triangles[row, 0], y - triangles[row, 1], z - triangles[row, 2]
    u = (tx * px + ty * py + tz * pz) * inv
    if u < -1e-9 or u > 1.0 + 1e-9:
        return _FAR
    qx, qy, qz = ty * e1z - tz * e1y, tz * e1x - tx * e1z, tx * e1y - ty * e1x
    v = (dx * qx + dy * qy + dz * qz) * inv
    if v < -1e-9 or u + v > 1.0 + 2e-9:
        return _FAR
    far = (e2x * qx + e2y * qy + e2z * qz) * inv
    return far if far > 1e-3 else _FAR
