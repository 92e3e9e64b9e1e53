"""What is in a building and not in its map: furniture along the walls, boxes, people, posters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array
from runs.simulation.facets import UP, Facet, Paint, level, upright
from runs.simulation.painter import Painter
from runs.simulation.walls import Region, WallPlane

#: Furniture leaves so much room around the robot's way.
_CLEAR_M = 0.55
#: How thick the boards of tables are.
_BOARD_M = 0.03
#: Posters stand out by this much.
_PAPER_M = 0.004


@dataclass(frozen=True, slots=True)
class Clutter:
    """How much there is: pieces on ten metres of wall, pieces and people on ten square metres of floor."""

    furniture_per_10m: float = 8.0
    posters_per_10m: float = 6.0
    boxes_per_10m2: float = 0.8
    people_per_10m2: float = 0.2


def scaled(factor: float) -> Clutter:
    """Return so many times the usual clutter; 0 is a building as bare as its map."""
    return Clutter(*(factor * getattr(Clutter(), one.name) for one in fields(Clutter)))


def clutter_facets(
    planes: Sequence[WallPlane],
    glazed: Sequence[BaseGeometry],
    regions: Sequence[Region],
    clutter: Clutter,
    keep_off: Array,
    painter: Painter,
    rng: np.random.Generator,
) -> list[Facet]:
    """Return all of it; `keep_off` (K, 2) stays free of what stands on the floor, and `glazed` of posters.

    `glazed`: each plane's panes, in its coordinates.
    """
    way = shapely.MultiPoint(keep_off).buffer(_CLEAR_M) if len(keep_off) else Polygon()
    shapely.prepare(way)
    facets: list[Facet] = []
    taken: list[Polygon] = []
    for plane, glass in zip(planes, glazed, strict=True):
        if regions[plane.region].passage:
            continue
        low_u, _, high_u, _ = plane.solid.bounds
        length = high_u - low_u
        for _ in range(rng.poisson(0.1 * clutter.posters_per_10m * length)):
            facets += _poster(plane, glass, painter, rng)
        for _ in range(rng.poisson(0.1 * clutter.furniture_per_10m * length)):
            size = rng.uniform([0.4, 0.25, 0.5], [1.2, 0.5, 2.1])
            at = rng.uniform(low_u, high_u)
            box = _against(plane, float(at), size)
            behind = shapely.box(at, 0.0, at + size[0], size[2])
            if plane.solid.covers(behind) and _fits(box, regions[plane.region], way, taken):
                taken.append(box)
                facets += _cabinet(box, float(size[2]), plane.region, bool(rng.random() < 0.6), painter)
    for number, region in enumerate(regions):
        if region.passage:
            continue
        for _ in range(rng.poisson(0.1 * clutter.boxes_per_10m2 * region.outline.area)):
            box = _turned(_somewhere(region, rng), rng.uniform([0.3, 0.3], [0.8, 0.6]), rng.uniform(0, np.pi))
            if _fits(box, region, way, taken):
                taken.append(box)
                height_m = float(rng.uniform(0.25, 1.1))
                stands = rng.random() < 0.5
                facets += (
                    _table(box, height_m, number, painter)
                    if stands
                    else _cabinet(box, height_m, number, False, painter)
                )
        for _ in range(rng.poisson(0.1 * clutter.people_per_10m2 * region.outline.area)):
            facets += _person(_somewhere(region, rng), number, region, way, taken, painter, rng)
    return facets


def _fits(shape: Polygon, region: Region, way: Polygon, taken: Sequence[Polygon]) -> bool:
    free = region.outline.contains(shape) and not way.intersects(shape)
    return free and not any(other.intersects(shape) for other in taken)


def _somewhere(region: Region, rng: np.random.Generator) -> Array:
    low_x, low_y, high_x, high_y = region.outline.bounds
    return np.array([rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)])


def _turned(middle: Array, size: Array, angle: float) -> Polygon:
    c, s = math.cos(angle), math.sin(angle)
    corners = 0.5 * size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Polygon(middle + corners @ np.array([[c, s], [-s, c]]))


def _against(plane: WallPlane, u: float, size: Array) -> Polygon:
    """Return the outline of something that stands with its back to a wall."""
    near, far = 0.03, 0.03 + float(size[1])
    ends = [(u, near), (u + float(size[0]), near), (u + float(size[0]), far), (u, far)]
    return Polygon([plane.point(along, 0.0, out)[:2] for along, out in ends])


def _cabinet(outline: Polygon, height_m: float, region: int, books: bool, painter: Painter) -> list[Facet]:
    """Return an upright box; its third side, the one away from the wall, may hold books."""
    corners = shapely.get_coordinates(outline.exterior)
    paint = painter.furniture(books=False)
    sides: list[Paint] = [painter.shade(paint, 0.9), paint, paint, paint]
    if books:
        sides[2] = painter.furniture(books=True)
    facets = [
        upright(p, q, (0.0, height_m), side, region)
        for p, q, side in zip(corners[:-1], corners[1:], sides, strict=True)
    ]
    return [*facets, level(outline, height_m, painter.shade(paint, 1.1), region)]


def _table(outline: Polygon, height_m: float, region: int, painter: Painter) -> list[Facet]:
    """Return a board on four legs."""
    paint, legs = painter.furniture(books=False), painter.furniture(books=False)
    corners = shapely.get_coordinates(outline.exterior)
    middle = corners[:-1].mean(axis=0)
    board = (height_m - _BOARD_M, height_m)
    sides = pairwise(corners)
    facets = [upright(p, q, board, painter.shade(paint, 0.8), region) for p, q in sides]
    facets += [level(outline, z, paint, region) for z in board]
    for corner in corners[:-1]:
        leg = shapely.get_coordinates(_turned(0.9 * corner + 0.1 * middle, np.array([0.04, 0.04]), 0.3))
        facets += [upright(p, q, (0.0, board[0]), legs, region) for p, q in pairwise(leg)]
    return facets


def _poster(plane: WallPlane, glass: BaseGeometry, painter: Painter, rng: np.random.Generator) -> list[Facet]:
    low_u, _, high_u, _ = plane.solid.bounds
    u, z = rng.uniform(low_u, high_u), rng.uniform(0.9, 1.7)
    paper = shapely.box(u, z, u + rng.uniform(0.3, 1.0), z + rng.uniform(0.3, 0.9))
    if not plane.solid.contains(paper) or glass.intersects(paper):
        return []
    along = np.append(plane.along, 0.0)
    return [Facet(paper, plane.point(0.0, 0.0, _PAPER_M), along, UP, painter.poster(), plane.region)]


def _person(
    middle: Array,
    number: int,
    region: Region,
    way: Polygon,
    taken: list[Polygon],
    painter: Painter,
    rng: np.random.Generator,
) -> list[Facet]:
    """Return somebody who stands there: legs, body and head as eight-sided columns."""
    tall = rng.uniform(1.55, 1.9)
    outline = _column(middle, 0.24)
    if not _fits(outline, region, way, taken):
        return []
    taken.append(outline)
    facets: list[Facet] = []
    for radius, low, high in ((0.16, 0.0, 0.5), (0.22, 0.5, 0.84), (0.1, 0.86, 1.0)):
        ring = _column(middle, radius)
        corners = shapely.get_coordinates(ring.exterior)
        paint = painter.furniture(books=False)
        sides = pairwise(corners)
        facets += [upright(p, q, (low * tall, high * tall), paint, number) for p, q in sides]
        facets.append(level(ring, high * tall, paint, number))
    return facets


def _column(middle: Array, radius: float) -> Polygon:
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    return Polygon(middle + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
