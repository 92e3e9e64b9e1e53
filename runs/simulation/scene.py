"""A whole building to be drawn, from its map: surfaces, paints, lamps and sunlight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array, frozen
from maps.wiremap import WireMap
from runs.simulation.assignment import assign
from runs.simulation.clutter import Clutter, clutter_facets
from runs.simulation.facets import UP, Facet, Material, Mesh, level, mesh_of
from runs.simulation.layers import wall_facets
from runs.simulation.painter import Painter, RoomLook
from runs.simulation.shading import Lights
from runs.simulation.walls import Region, low_obstacles, planes_of, regions_of

#: Lamps lie this far apart where the map has none; the nearest few light a place.
_LAMP_SPACING_M, _LAMPS = 3.0, 6
#: Level loops this close below a ceiling hang from it.
_HANGING_M = 0.4
_FREE_STRIP_M = 0.04
_SAME_M = 0.002


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a building looks like beside its map.

    `light`: of the lamps, 1 for a usual evening. `sun`: whether it shines in. `clutter`: how much there is
    that the map does not have.
    """

    light: float = 1.0
    sun: bool = True
    clutter: Clutter = field(default_factory=Clutter)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Triangles with paints, and what lights them; `brightness` of the lamps, 1 for a usual evening."""

    mesh: Mesh
    lights: Lights
    brightness: float


def scene_of(
    wire_map: WireMap, conditions: Conditions, rng: np.random.Generator, eye_m: float, keep_off: Array
) -> Scene:
    """Build the scene of a map.

    `eye_m`: the camera's height, which ceilings are above. `keep_off`: (K, 2) places, those where the robot
    drives, that furniture leaves free.
    """
    painter = Painter(rng)
    regions = regions_of(wire_map, eye_m)
    planes = planes_of(wire_map, regions)
    looks = [painter.look(region) for region in regions]
    lines, others = assign(wire_map, regions, planes)
    facets = _shells(wire_map, regions, looks)
    glazed = []
    for number, plane in enumerate(planes):
        on_wall = wall_facets(plane, lines.get(number, []), looks[plane.region], painter)
        glazed.append(shapely.union_all([f.polygon for f in on_wall if f.paint.material is Material.PANE]))
        facets += on_wall
    facets += _free_facets(wire_map, others, regions, looks, painter)
    windows = [facet for facet in facets if facet.paint.material is Material.PANE]
    lamps = [facet for facet in facets if facet.paint.material is Material.LAMP]
    facets += clutter_facets(planes, glazed, regions, conditions.clutter, keep_off, painter, rng)
    places, lamp_rows = _lamps(regions, lamps, conditions.light)
    azimuth, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.9)
    sun = np.array([math.cos(azimuth), math.sin(azimuth), math.tan(height)])
    suns, sun_rows = _windows(regions, windows if conditions.sun else [])
    towards = frozen(sun / np.linalg.norm(sun))
    lights = Lights(places, lamp_rows, suns, sun_rows, towards)
    return Scene(mesh_of(facets), lights, conditions.light)


def _shells(wire_map: WireMap, regions: Sequence[Region], looks: Sequence[RoomLook]) -> list[Facet]:
    """Return floors, ceilings, and the tops of low obstacles."""
    facets = []
    covered: list[BaseGeometry] = [region.outline for region in regions]
    for outline, top_m in low_obstacles(wire_map):
        number = int(np.argmin([region.outline.distance(outline) for region in regions]))
        covered[number] = covered[number].union(outline)
        facets.append(level(outline, top_m, looks[number].door, number))
    for number, (region, look, over) in enumerate(zip(regions, looks, covered, strict=True)):
        facets.append(level(region.outline, 0.0, look.floor, number))
        facets.append(level(over, region.ceiling_m, look.ceiling, number))
    return facets


def _free_facets(
    wire_map: WireMap,
    rows: NDArray[np.int64],
    regions: Sequence[Region],
    looks: Sequence[RoomLook],
    painter: Painter,
) -> list[Facet]:
    """Return what segments away from walls stand for: level loops are lamps or tables, the others thin bars."""
    facets: list[Facet] = []
    ends = wire_map.endpoints[rows]
    flat = np.abs(ends[:, 0, 2] - ends[:, 1, 2]) < _SAME_M
    closed = np.zeros(len(rows), bool)
    heights = np.round(ends[:, :, 2].mean(axis=1) / _SAME_M)
    for height in np.unique(heights[flat]):
        here = np.flatnonzero(flat & (heights == height))
        linework = shapely.union_all(shapely.set_precision(shapely.linestrings(ends[here, :, :2]), 1e-3))
        z = float(ends[here, :, 2].mean())
        for loop in shapely.get_parts(shapely.polygonize([linework])):
            middles = shapely.points(ends[here, :, :2].mean(axis=1))
            on = shapely.distance(loop.boundary, middles) < _SAME_M
            closed[here[on]] = True
            region = _region_at(regions, loop.representative_point())
            hangs = 0.0 <= regions[region].ceiling_m - z < _HANGING_M
            paint = painter.lamp() if hangs else painter.furniture(books=False)
            # At the ceiling itself two surfaces would be one.
            z_drawn = z - 1e-4 if abs(regions[region].ceiling_m - z) < 1e-4 else z
            facets.append(level(loop, z_drawn, paint, region))
            if hangs and regions[region].ceiling_m - z > _SAME_M:
                facets += _rim(loop, z, regions[region].ceiling_m, region, looks[region])
    for (p, q), row in zip(ends[~closed], rows[~closed], strict=True):
        region = _region_at(regions, shapely.Point(*wire_map.sight_endpoints[row].mean(axis=0)[:2]))
        facets.append(_bar(p, q, region, painter))
    return facets


def _rim(loop: Polygon, low_m: float, high_m: float, region: int, look: RoomLook) -> list[Facet]:
    corners = shapely.get_coordinates(loop.exterior)
    sides = pairwise(corners)
    return [
        Facet(
            shapely.box(0.0, 0.0, float(np.hypot(*(q - p))), high_m - low_m),
            np.array([*p, low_m]),
            np.append((q - p) / np.hypot(*(q - p)), 0.0),
            UP,
            look.frame,
            region,
        )
        for p, q in sides
    ]


def _bar(p: Array, q: Array, region: int, painter: Painter) -> Facet:
    """Return a thin flat bar with a segment as its edge: it hangs down, or stands beside."""
    way = (q - p) / np.linalg.norm(q - p)
    down = np.array([0.0, 0.0, -1.0]) if abs(way[2]) < 0.9 else np.array([0.8, 0.6, 0.0])
    aside = down - (down @ way) * way
    box = shapely.box(0.0, 0.0, float(np.linalg.norm(q - p)), _FREE_STRIP_M)
    return Facet(box, p, way, aside / np.linalg.norm(aside), painter.furniture(books=False), region)


def _region_at(regions: Sequence[Region], place: shapely.Point) -> int:
    return int(np.argmin([region.outline.distance(place) for region in regions]))


def _lamps(
    regions: Sequence[Region], facets: Sequence[Facet], light: float
) -> tuple[Array, NDArray[np.int64]]:
    """Return the lamps that light each region: the map's, or a grid below the ceiling."""
    rows: list[Array] = []
    starts = [0]
    for number, region in enumerate(regions):
        middle = np.array([*region.outline.centroid.coords[0], region.ceiling_m])
        places = [_middle(facet) for facet in facets if facet.region == number]
        if not places:
            low_x, low_y, high_x, high_y = region.outline.bounds
            xs = _spread(low_x, high_x)
            places = [np.array([x, y, region.ceiling_m - 0.05]) for x in xs for y in _spread(low_y, high_y)]
        places = sorted(places, key=lambda place: float(np.hypot(*(place - middle)[:2])))[:_LAMPS]
        power = light * region.outline.area / max(1, len(places)) * 0.16
        rows += [np.append(place, min(power, 2.0)) for place in places]
        starts.append(len(rows))
    return np.array(rows).reshape(-1, 4), np.array(starts, np.int64)


def _spread(low: float, high: float) -> Array:
    count = max(1, round((high - low) / _LAMP_SPACING_M))
    return low + (np.arange(count) + 0.5) * (high - low) / count


def _middle(facet: Facet) -> Array:
    middle: Array = facet.points_map(shapely.get_coordinates(facet.polygon.centroid))[0]
    return middle


def _windows(regions: Sequence[Region], panes: Sequence[Facet]) -> tuple[Array, NDArray[np.int64]]:
    """Return each region's panes as the sun sees them: (K, 6) upper corner, plan edge from it, height."""
    rows: list[Array] = []
    starts = [0]
    for number in range(len(regions)):
        for facet in panes:
            if facet.region == number:
                low_u, low_v, high_u, high_v = facet.polygon.bounds
                corner, end = facet.points_map(np.array([[low_u, high_v], [high_u, high_v]]))
                rows.append(np.concatenate([corner, (end - corner)[:2], [high_v - low_v]]))
        starts.append(len(rows))
    return np.array(rows).reshape(-1, 6), np.array(starts, np.int64)
