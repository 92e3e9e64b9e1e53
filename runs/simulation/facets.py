"""What a simulated building is drawn from: flat facets, each with a paint, and the triangles they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array, frozen

#: Smaller facets than this [m^2] are what cutting leaves behind.
_CRUMB_M2 = 1e-6
_LEAF = 4


class Material(IntEnum):
    """What a facet's paint looks like; `runs.simulation.shading` draws them."""

    PLASTER = 0
    PLANKS = 1
    TILES = 2
    WOOD = 3
    BOOKS = 4
    PANE = 5
    LAMP = 6
    POSTER = 7
    CARPET = 8
    DOOR = 9


@dataclass(frozen=True, slots=True)
class Paint:
    """A facet's look: reflectance in [0, 1] (or brightness, of what shines), pattern and its strength.

    `size_m`: of the pattern along the facet's two axes. `contrast`: of the pattern, a share of the albedo.
    """

    material: Material
    albedo: float
    contrast: float = 0.04
    size_m: tuple[float, float] = (0.5, 0.5)
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Facet:
    """A polygon (metres, in the plane's own two coordinates) on a plane in the map frame; seen from both sides.

    A point (u, v) of it is `origin + u * across + v * up`; `across` and `up` (3,) are orthogonal units.
    `region`: the part of the floor whose lamps light it.
    """

    polygon: BaseGeometry
    origin: Array
    across: Array
    up: Array
    paint: Paint
    region: int

    def points_map(self, points: Array) -> Array:
        """Return points (..., 2) of the plane in the map frame, (..., 3)."""
        result: Array = self.origin + points[..., :1] * self.across + points[..., 1:] * self.up
        return result


#: Upright axis of a facet on a wall; both axes of one that lies.
UP = frozen(np.array([0.0, 0.0, 1.0]))
EAST, NORTH = frozen(np.array([1.0, 0.0, 0.0])), frozen(np.array([0.0, 1.0, 0.0]))


def level(polygon: BaseGeometry, height_m: float, paint: Paint, region: int) -> Facet:
    """Return a facet that lies flat: plan coordinates at a height."""
    return Facet(polygon, np.array([0.0, 0.0, height_m]), EAST, NORTH, paint, region)


def upright(p: Array, q: Array, heights_m: tuple[float, float], paint: Paint, region: int) -> Facet:
    """Return an upright rectangle over a plan edge (2,) to (2,), from one height to another."""
    way = q - p
    length = float(np.hypot(*way))
    across = np.array([way[0] / length, way[1] / length, 0.0])
    return Facet(
        shapely.box(0.0, heights_m[0], length, heights_m[1]), np.array([*p, 0.0]), across, UP, paint, region
    )


class Mesh(NamedTuple):
    """Triangles in a tree of boxes, as the ray caster wants them; a plain tuple for the compiler.

    `triangles`: (T, 9): a corner and the two edges from it. `facet_of`: (T,). `boxes`: (B, 6) lower and upper
    corners. `links`: (B, 2): the two children, or the first triangle and minus the count of a leaf.
    `planes`: (F, 9) origin, across, up of each facet. `paints`: (F, 7) material, albedo, contrast, the two
    sizes, seed, region.
    """

    triangles: Array
    facet_of: NDArray[np.int64]
    boxes: Array
    links: NDArray[np.int64]
    planes: Array
    paints: Array


def mesh_of(facets: Sequence[Facet]) -> Mesh:
    """Cut facets into triangles and sort them into a tree."""
    corners, owners = [], []
    for number, facet in enumerate(facets):
        for part in _polygons(facet.polygon):
            pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(part))
            plan = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
            corners.append(facet.points_map(plan))
            owners.append(np.full(len(plan), number))
    points, owner = np.concatenate(corners), np.concatenate(owners)
    order, boxes, links = _tree(points)
    points = points[order]
    triangles = np.concatenate(
        [points[:, 0], points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], axis=1
    )
    planes = np.array([np.concatenate([facet.origin, facet.across, facet.up]) for facet in facets])
    paints = np.array(
        [
            (f.paint.material, f.paint.albedo, f.paint.contrast, *f.paint.size_m, f.paint.seed, f.region)
            for f in facets
        ],
        float,
    )
    return Mesh(frozen(triangles), owner[order], boxes, links, frozen(planes), frozen(paints))


def _polygons(shape: BaseGeometry) -> list[Polygon]:
    parts = shapely.get_parts(shapely.force_2d(shape))
    return [part for part in parts if isinstance(part, Polygon) and part.area > _CRUMB_M2]


def _tree(points: Array) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
    """Split triangles (T, 3, 3) in halves along the longest side of their box, down to a few.

    Returns the order of the triangles, boxes (B, 6) and links (B, 2).
    """
    low, high = points.min(axis=1), points.max(axis=1)
    middle = 0.5 * (low + high)
    boxes: list[Array] = []
    links: list[tuple[int, int]] = []
    order: list[NDArray[np.int64]] = []
    placed = 0
    waiting = [(np.arange(len(points)), -1, 0)]
    while waiting:
        rows, parent, side = waiting.pop()
        number = len(boxes)
        boxes.append(np.concatenate([low[rows].min(axis=0), high[rows].max(axis=0)]))
        if parent >= 0:
            first, second = links[parent]
            links[parent] = (number, second) if side == 0 else (first, number)
        if len(rows) <= _LEAF:
            links.append((placed, -len(rows)))
            order.append(rows)
            placed += len(rows)
            continue
        axis = int(np.argmax(np.ptp(middle[rows], axis=0)))
        rows = rows[np.argsort(middle[rows, axis], kind="stable")]
        half = len(rows) // 2
        links.append((0, 0))
        waiting += [(rows[:half], number, 0), (rows[half:], number, 1)]
    return np.concatenate(order), np.array(boxes), np.array(links, np.int64)
