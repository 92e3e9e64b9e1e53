"""A map's floor as rooms and passages with ceilings, and the wall planes around them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array, frozen
from maps.rooms import Room, ceiling_of
from maps.wiremap import WireMap

#: A lintel's ends belong to the corners of the floor within this distance: frames stand before their walls.
_SNAP_M = 0.10
#: Edges belong to the region within this distance, and to the nearest one elsewhere.
_REACH_M = 0.06
#: Narrower parts of the floor under lintels are passages through walls.
_PASSAGE_M = 0.6
_SAME_M, _PARALLEL = 1e-3, 0.99995
#: The floor's border and its low walls are the same lines; another wall may stand a millimetre off.
_ON_M = 1e-5
#: A ceiling where no edge shows one; and the least that is above the eye.
_USUAL_M, _HEADROOM_M = 2.6, 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A part of the floor under one ceiling: `outline` in plan, `ceiling_m`, the segments `rows` near it."""

    outline: Polygon
    ceiling_m: float
    rows: NDArray[np.int64]
    passage: bool


@dataclass(frozen=True, slots=True, eq=False)
class WallPlane:
    """All walls of a region in one vertical plane; coordinates are (u, z): metres along, and up.

    `along`, `normal`: (2,) units in plan, the normal into the room; a point is
    `u * along + (offset_m + d) * normal`, with d how far it stands out of the plane.
    `solid`: where there is wall, in (u, z).
    """

    region: int
    along: Array
    normal: Array
    offset_m: float
    solid: BaseGeometry
    ceiling_m: float

    def flat(self, points: Array) -> tuple[Array, Array, Array]:
        """Return u, z and d of points (..., 3)."""
        plan = points[..., :2]
        return plan @ self.along, points[..., 2], plan @ self.normal - self.offset_m

    def point(self, u: float, z: float, d: float) -> Array:
        """Return a point of the map, (3,)."""
        return np.append(u * self.along + (self.offset_m + d) * self.normal, z)


def regions_of(wire_map: WireMap, eye_m: float) -> tuple[Region, ...]:
    """Cut the floor under lintels, and find each part's ceiling, above an eye at that height."""
    lines, bottoms = _mouths(wire_map)
    linework = shapely.union_all([wire_map.floor.boundary, *lines])
    parts = [
        part
        for part in shapely.get_parts(shapely.polygonize([linework]))
        if wire_map.floor.contains(part.representative_point())
    ]
    middles = shapely.points(wire_map.sight_endpoints.mean(axis=1)[:, :2])
    distances = np.array([shapely.distance(part, middles) for part in parts])
    near = (distances <= _REACH_M) | (distances == distances.min(axis=0))
    known: list[float | None] = []
    passages = []
    for number, part in enumerate(parts):
        touching = [
            bottom for line, bottom in zip(lines, bottoms, strict=True) if part.distance(line) < _SAME_M
        ]
        width, depth = _extent(part)
        passages.append(bool(touching) and min(width, depth) < _PASSAGE_M)
        rows = np.flatnonzero(near[number])
        known.append(min(touching) if passages[-1] else ceiling_of(Room(part, rows), wire_map))
    usual = float(np.median([height for height in known if height is not None] or [_USUAL_M]))
    regions = []
    for number, (part, height, passage) in enumerate(zip(parts, known, passages, strict=True)):
        rows = np.flatnonzero(near[number])
        ceiling_m = usual if height is None else height
        if height is None and len(rows):
            ceiling_m = max(usual, float(wire_map.endpoints[rows, :, 2].max()))
        least = 0.0 if passage else eye_m + _HEADROOM_M
        regions.append(Region(part, max(ceiling_m, least), rows, passage))
    return tuple(regions)


def planes_of(wire_map: WireMap, regions: tuple[Region, ...]) -> tuple[WallPlane, ...]:
    """Return the wall planes of all regions."""
    stretches = _Stretches(wire_map, regions)
    planes: list[WallPlane] = []
    for number, region in enumerate(regions):
        groups: list[tuple[Array, Array, float, list[BaseGeometry]]] = []
        for p, q in _edges(region.outline):
            foot_m, head_m = stretches.heights(shapely.Point(0.5 * (p + q)), region.ceiling_m)
            if head_m - foot_m < _SAME_M:
                continue
            along = (q - p) / np.hypot(*(q - p))
            normal = np.array([-along[1], along[0]])
            offset = float(normal @ p)
            for a, _, c, pieces in groups:
                if a @ along > _PARALLEL and abs(c - offset) < _SAME_M:
                    pieces.append(shapely.box(float(a @ p), foot_m, float(a @ q), head_m))
                    break
            else:
                piece = shapely.box(float(along @ p), foot_m, float(along @ q), head_m)
                groups.append((along, normal, offset, [piece]))
        planes += [
            WallPlane(number, frozen(a), frozen(n), c, shapely.union_all(pieces), region.ceiling_m)
            for a, n, c, pieces in groups
        ]
    return tuple(planes)


class _Stretches:
    """From where to where up walls are solid: under lintels they are not, nor above low obstacles."""

    def __init__(self, wire_map: WireMap, regions: tuple[Region, ...]) -> None:
        mouths, bottoms = _mouths(wire_map)
        # Where the ceiling beyond is lower than the lintel, the wall comes down to it.
        feet = [
            min(
                [bottom, *(one.ceiling_m for one in regions if one.outline.distance(line.centroid) < _SAME_M)]
            )
            for line, bottom in zip(mouths, bottoms, strict=True)
        ]
        low = np.isfinite(wire_map.wall_tops_m)
        self._mouths, self._feet = np.array(mouths, object), np.array(feet)
        self._low = np.array([LineString(wall) for wall in wire_map.walls[low]], object)
        self._tops = wire_map.wall_tops_m[low]

    def heights(self, place: shapely.Point, ceiling_m: float) -> tuple[float, float]:
        """Return the foot and the head of the wall at a place on a region's outline."""
        open_m = self._feet[shapely.distance(self._mouths, place) < _SAME_M]
        if len(open_m):
            return float(open_m.min()), ceiling_m
        tops = self._tops[shapely.distance(self._low, place) < _ON_M]
        return 0.0, min(ceiling_m, float(tops.max(initial=0.0))) if len(tops) else ceiling_m


def low_obstacles(wire_map: WireMap) -> tuple[tuple[Polygon, float], ...]:
    """Return the obstacles that one can look over: outlines in plan, and tops."""
    found = []
    for top_m in np.unique(wire_map.wall_tops_m[np.isfinite(wire_map.wall_tops_m)]).tolist():
        sides = [LineString(wall) for wall in wire_map.walls[wire_map.wall_tops_m == top_m]]
        for outline in shapely.get_parts(shapely.polygonize([shapely.union_all(sides)])):
            found.append((outline, top_m))
    return tuple(found)


def _mouths(wire_map: WireMap) -> tuple[list[LineString], list[float]]:
    """Return lintels, moved to the corners of the floor they span, and their bottoms; not those of closed doors."""
    border = wire_map.floor.boundary
    corners = shapely.get_coordinates(border)
    lines, bottoms = [], []
    for ends, bottom in zip(wire_map.lintels, wire_map.lintel_bottoms_m.tolist(), strict=True):
        snapped = []
        for end in ends:
            away = np.hypot(*(corners - end).T)
            nearest = corners[away.argmin()]
            if away.min() > _SNAP_M:
                nearest = shapely.get_coordinates(shapely.shortest_line(border, shapely.Point(end)))[0]
            snapped.append(nearest)
        line = LineString(snapped)
        if (
            line.length > _SNAP_M
            and border.distance(line.centroid) > 0.02
            and wire_map.floor.contains(line.centroid)
        ):
            lines.append(line)
            bottoms.append(bottom)
    return lines, bottoms


def _extent(part: Polygon) -> tuple[float, float]:
    """Return the sides of the smallest rectangle around a polygon."""
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(part))
    if len(box) < 4:
        return 0.0, 0.0
    return float(np.hypot(*(box[1] - box[0]))), float(np.hypot(*(box[2] - box[1])))


def _edges(outline: Polygon) -> list[tuple[Array, Array]]:
    """Return the edges of a polygon's rings, its inside on their left."""
    oriented = MultiPolygon([shapely.geometry.polygon.orient(outline)])
    rings = [ring for part in oriented.geoms for ring in (part.exterior, *part.interiors)]
    edges: list[tuple[Array, Array]] = []
    for ring in rings:
        corners = shapely.get_coordinates(ring)
        edges += [(p, q) for p, q in pairwise(corners) if np.hypot(*(q - p)) > _SAME_M]
    return edges
