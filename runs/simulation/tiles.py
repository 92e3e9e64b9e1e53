"""What a tile of a picture could show: the triangles inside its frustum. Compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from runs.simulation.facets import Mesh

TILE_PX = 16


@njit(cache=True, nogil=True)
def tile_bounds(
    rays: Array, rotations: Array, centres: Array, top: int, left: int, bottom: int, right: int
) -> tuple[Array, float]:
    """Return the tile's box in the first moment's normalised coordinates, and how far the centre moves.

    The box (4,), lower and upper x and y, holds the tile's rays of all moments.
    """
    low_x = high_x = rays[top, left, 0]
    low_y = high_y = rays[top, left, 1]
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            low_x, high_x = min(low_x, rays[row, column, 0]), max(high_x, rays[row, column, 0])
            low_y, high_y = min(low_y, rays[row, column, 1]), max(high_y, rays[row, column, 1])
    bounds = np.array([low_x, high_x, low_y, high_y])
    moved = 0.0
    for moment in range(1, len(centres)):
        turn = rotations[0].T @ rotations[moment]
        moved = max(moved, np.sqrt(np.sum((centres[moment] - centres[0]) ** 2)))
        for x in (low_x, high_x):
            for y in (low_y, high_y):
                depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]
                u = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) / depth
                v = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]) / depth
                bounds[0], bounds[1] = min(bounds[0], u), max(bounds[1], u)
                bounds[2], bounds[3] = min(bounds[2], v), max(bounds[3], v)
    return bounds, moved


@njit(cache=True, nogil=True)
def candidates(
    rotation: Array,
    centre: Array,
    bounds: Array,
    margin_m: float,
    mesh: Mesh,
    rows: NDArray[np.int64],
    depths: Array,
) -> int:
    """Write which triangles a frustum holds, or may, into `rows`, and their least depths; return how many.

    `rotation`, `centre`: map_from_optical. `bounds`: from `tile_bounds`; the frustum is wider by `margin_m`.
    """
    triangles, boxes, links = mesh.triangles, mesh.boxes, mesh.links
    planes = np.empty((5, 3))
    for axis in range(3):
        x, y, z = rotation[axis, 0], rotation[axis, 1], rotation[axis, 2]
        planes[0, axis], planes[1, axis] = x - bounds[0] * z, bounds[1] * z - x
        planes[2, axis], planes[3, axis] = y - bounds[2] * z, bounds[3] * z - y
        planes[4, axis] = z
    slack = np.empty(5)
    for plane in range(5):
        slack[plane] = 1e-6 + margin_m * np.sqrt(np.sum(planes[plane] ** 2))
    stack = np.empty(64, np.int64)
    stack[0] = 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if not _reaches(planes, slack, centre, boxes, node):
            continue
        first, second = links[node, 0], links[node, 1]
        if second >= 0:
            stack[depth], stack[depth + 1] = first, second
            depth += 2
            continue
        for row in range(first, first - second):
            least = _least_depth(planes, slack, centre, triangles, row)
            if least >= 0.0:
                rows[count], depths[count] = row, least
                count += 1
    return count


@njit(cache=True, nogil=True)
def _reaches(planes: Array, slack: Array, centre: Array, boxes: Array, node: int) -> bool:
    """Whether a box may be inside: its farthest corner is, along every plane's normal."""
    for plane in range(5):
        far = 0.0
        for axis in range(3):
            normal = planes[plane, axis]
            far += normal * ((boxes[node, axis + 3] if normal > 0.0 else boxes[node, axis]) - centre[axis])
        if far < -slack[plane]:
            return False
    return True


@njit(cache=True, nogil=True)
def _least_depth(planes: Array, slack: Array, centre: Array, triangles: Array, row: int) -> float:
    """Return the depth of a triangle's nearest corner, not below zero; -1 where it is outside."""
    for plane in range(5):
        base = first = second = 0.0
        for axis in range(3):
            normal = planes[plane, axis]
            base += normal * (triangles[row, axis] - centre[axis])
            first += normal * triangles[row, axis + 3]
            second += normal * triangles[row, axis + 6]
        if base + max(0.0, max(first, second)) < -slack[plane]:
            return -1.0
    # The last plane's normal is the optical axis.
    return max(0.0, base + min(0.0, min(first, second)))
