"""The navigable floor: polygons with holes, the walls they imply, and what one can look over."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient
from shapely.ops import unary_union

from maps.poses import Array

#: How far into the floor an edge's end points are moved for sight lines; skirtings, linings and window
#: recesses keep their edges within a few centimetres of the wall they belong to.
SIGHT_MARGIN_M = 0.04


def merged_floor(polygons: list[Polygon]) -> MultiPolygon:
    """Return the union of the polygons as one MultiPolygon, outer rings counter-clockwise."""
    # A ring that collapsed to a line has no inside, and its holes nothing to be cut from.
    areas = [polygon for polygon in polygons if polygon.convex_hull.area > 0.0]
    union = unary_union([shapely.make_valid(polygon) for polygon in areas])
    parts = [part for part in shapely.get_parts(union) if isinstance(part, Polygon)]
    return MultiPolygon([orient(part) for part in parts if part.area > 0.0])


def walls_of(floor: MultiPolygon, low_obstacles: list[tuple[Polygon, float]]) -> tuple[Array, Array]:
    """Return the floor's boundary edges (W, 2, 2), the floor on their left, and their tops (W,) in m.

    `low_obstacles`: holes that one can look over, with their tops; every other wall is infinitely high.
    """
    rings = [ring for part in floor.geoms for ring in (part.exterior, *part.interiors)]
    corners = [shapely.get_coordinates(ring) for ring in rings]
    edges = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in corners]
    walls = np.concatenate(edges) if edges else np.zeros((0, 2, 2))
    walls = walls[np.linalg.norm(walls[:, 1] - walls[:, 0], axis=1) > 0.0]
    tops = np.full(len(walls), np.inf)
    middles = shapely.points(walls.mean(axis=1))
    for hole, top in low_obstacles:
        tops[shapely.distance(hole.exterior, middles) < 1e-6] = top
    return walls, tops


def into_floor(floor: MultiPolygon, points: Array, margin_m: float = SIGHT_MARGIN_M) -> Array:
    """Return the points (N, 2) moved to the nearest place at least `margin_m` inside the floor."""
    inner = floor.buffer(-margin_m)
    target = floor if inner.is_empty else inner
    nearest = shapely.shortest_line(target, shapely.points(points))
    return np.asarray(shapely.get_coordinates(shapely.get_point(nearest, 0)), np.float64)
