"""Map segments on a wall plane as parts with areas: panels, frames that stand out, windows in recesses.

Segments at one distance from the wall are one layer. Those that close a polygon make a part; a segment left
over gets a narrow strip beside it. So every edge of the map lies between two surfaces that look different.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array
from runs.simulation.facets import UP, Facet, Paint
from runs.simulation.painter import Painter, RoomLook
from runs.simulation.walls import WallPlane

#: Distances from the wall that differ by less are one layer.
_LAYER_M = 0.002
#: Lines that end this near to each other meet.
_MEET_M = 0.015
#: Ends of horizontal lines above each other are joined up to this height, as those of a skirting are.
_CLOSING_M = 0.4
_STRIP_M = (0.025, 0.06)
_OFF_M = 0.002
#: How wide the rail between two paints of a wall is.
_RAIL_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class PlaneLine:
    """A segment in a wall plane's coordinates: `ends` (2, 2) of (u, z), `out_m` how far it stands out."""

    ends: Array
    out_m: float
    kind: str

    @property
    def line(self) -> LineString:
        """It as a line."""
        return LineString(self.ends)


def wall_facets(plane: WallPlane, lines: list[PlaneLine], look: RoomLook, painter: Painter) -> list[Facet]:
    """Return the facets of a wall plane and of what is on it, before it and in its recesses."""
    wall = _Wall(plane, look, painter)
    layers: dict[int, list[PlaneLine]] = {}
    for line in sorted(lines, key=lambda one: one.out_m):
        layers.setdefault(round(line.out_m / _LAYER_M), []).append(line)
    wall.lay_flush(layers.pop(0, []))
    for _, layer in sorted(layers.items()):
        if layer[0].out_m < 0.0:
            wall.lay_recessed(layer)
        else:
            wall.lay_before(layer)
    return wall.facets()


class _Wall:
    """A wall plane being built up."""

    def __init__(self, plane: WallPlane, look: RoomLook, painter: Painter) -> None:
        self._plane, self._look, self._painter = plane, look, painter
        self._cells: list[tuple[BaseGeometry, Paint]] = []
        self._done: list[Facet] = []

    def lay_flush(self, lines: list[PlaneLine]) -> None:
        """Divide the wall itself."""
        solid = self._plane.solid
        shapes = _closed([*_extended(lines), solid.boundary])
        shapes = [shape for shape in shapes if shape.intersection(solid).area > 0.5 * shape.area]
        largest = max((shape.area for shape in shapes), default=0.0)
        cells: list[tuple[BaseGeometry, Paint]] = []
        for shape in shapes:
            kind = _kind(shape, lines)
            plain = shape.area == largest or not kind
            paint = (
                self._look.wall
                if plain
                else self._painter.part(kind, shape.area, self._look.wall, self._look)
            )
            cells.append((shape, paint))
        strips = [_strip(line, self._painter) for line in _left_over(lines, shapes)]
        for strip in strips:
            on_wall = strip.intersection(solid)
            cells = [(cell.difference(strip), paint) for cell, paint in cells]
            cells.append((on_wall, self._painter.strip(self._look.wall)))
        self._cells = cells

    def lay_recessed(self, lines: list[PlaneLine]) -> None:
        """Open the wall where a layer lies behind it: its parts, a frame around them, and the reveal."""
        out_m = float(np.median([line.out_m for line in lines]))
        shapes = _closed(_extended(lines))
        shapes += [_strip(line, self._painter) for line in _left_over(lines, shapes)]
        whole = shapely.union_all([shape.buffer(1e-6) for shape in shapes])
        for part in shapely.get_parts(whole):
            inside = [shape for shape in shapes if part.contains(shape.representative_point())]
            opening = self._opened(part)
            frame = opening.difference(shapely.union_all(inside))
            self._add(frame, out_m, self._painter.part("window frame", 0.0, self._look.wall, self._look))
            for shape in inside:
                kind = _kind(shape, lines)
                self._add(shape, out_m, self._painter.part(kind, shape.area, self._look.wall, self._look))
            self._add_sides(opening, out_m, self._painter.strip(self._look.wall))

    def lay_before(self, lines: list[PlaneLine]) -> None:
        """Put a layer before the wall: solid parts with sides; not where the floor goes on behind them."""
        out_m = float(np.median([line.out_m for line in lines]))
        solid = self._plane.solid
        shapes = _closed([*_extended(lines), *_closings(lines), *self._bounds()])
        solid_shapes = []
        for shape in shapes:
            kind = _kind(shape, lines)
            if kind and solid.intersection(shape).area > 0.5 * shape.area:
                paint = self._painter.part(kind, shape.area, self._look.wall, self._look)
                solid_shapes.append((shape, paint))
        for line in _left_over(lines, [shape for shape, _ in solid_shapes]):
            solid_shapes.append((_strip(line, self._painter), self._painter.strip(self._look.wall)))
        for shape, paint in solid_shapes:
            self._add(shape, out_m, paint)
            self._add_sides(shape, out_m, self._painter.side(paint))

    def facets(self) -> list[Facet]:
        """Return all that was laid; the wall's lower part gets its own paint last."""
        for cell, paint in self._cells:
            if self._look.dado is None or paint is not self._look.wall:
                self._add(cell, 0.0, paint)
                continue
            low_u, _, high_u, _ = self._plane.solid.bounds
            below = shapely.box(low_u, -1.0, high_u, self._look.dado_m)
            rail = shapely.box(low_u, self._look.dado_m - _RAIL_M, high_u, self._look.dado_m)
            self._add(cell.intersection(below).difference(rail), 0.0, self._look.dado)
            self._add(cell.intersection(rail), 0.0, self._painter.shade(self._look.dado, 0.6))
            self._add(cell.difference(below), 0.0, paint)
        return self._done

    def _opened(self, part: BaseGeometry) -> BaseGeometry:
        """Take the smallest cell around a recessed part out of the wall, or the part's own outline."""
        around = [
            number
            for number, (cell, paint) in enumerate(self._cells)
            if paint is not self._look.wall and cell.intersection(part).area > 0.95 * part.area
        ]
        if around:
            number = min(around, key=lambda one: float(self._cells[one][0].area))
            return self._cells.pop(number)[0]
        opening = shapely.box(*part.bounds)
        self._cells = [(cell.difference(opening), paint) for cell, paint in self._cells]
        return opening

    def _bounds(self) -> list[BaseGeometry]:
        """Return the lines of the floor and the ceiling in the plane."""
        low_u, _, high_u, _ = self._plane.solid.buffer(0.5).bounds
        return [LineString([(low_u, z), (high_u, z)]) for z in (0.0, self._plane.ceiling_m)]

    def _add(self, shape: BaseGeometry, out_m: float, paint: Paint) -> None:
        if shape.area > 0.0:
            along = np.append(self._plane.along, 0.0)
            origin = self._plane.point(0.0, 0.0, out_m)
            self._done.append(Facet(shape, origin, along, UP, paint, self._plane.region))

    def _add_sides(self, shape: BaseGeometry, out_m: float, paint: Paint) -> None:
        """Add what leads from a part's outline back to the wall."""
        back = np.append(-np.sign(out_m) * self._plane.normal, 0.0)
        for part in shapely.get_parts(shape):
            if not isinstance(part, Polygon):
                continue
            for ring in (part.exterior, *part.interiors):
                corners = shapely.get_coordinates(ring)
                for p, q in pairwise(corners):
                    length = float(np.hypot(*(q - p)))
                    if length < _OFF_M or max(p[1], q[1]) < _OFF_M:
                        continue
                    start = self._plane.point(p[0], p[1], out_m)
                    across = (self._plane.point(q[0], q[1], out_m) - start) / length
                    side = shapely.box(0.0, 0.0, length, abs(out_m))
                    self._done.append(Facet(side, start, across, back, paint, self._plane.region))


def _extended(lines: list[PlaneLine]) -> list[BaseGeometry]:
    """Return lines that reach a little beyond their ends, so that those which should meet do."""
    longer: list[BaseGeometry] = []
    for line in lines:
        way = line.ends[1] - line.ends[0]
        reach = _MEET_M * way / np.hypot(*way)
        longer.append(LineString([line.ends[0] - reach, line.ends[1] + reach]))
    return longer


def _closings(lines: list[PlaneLine]) -> list[BaseGeometry]:
    """Return upright lines between the ends of level lines that lie closely above each other, or the floor."""
    level = [line for line in lines if abs(line.ends[1, 1] - line.ends[0, 1]) < _OFF_M]
    ends = np.concatenate([line.ends for line in level]) if level else np.zeros((0, 2))
    found: list[BaseGeometry] = []
    for u, z in ends:
        below = ends[(np.abs(ends[:, 0] - u) < 2.0 * _MEET_M) & (ends[:, 1] < z - _OFF_M)]
        foot = max([0.0, *below[:, 1].tolist()])
        if _OFF_M < z - foot < _CLOSING_M:
            found.append(LineString([(u, foot - 0.001), (u, z + 0.001)]))
    return found


def _closed(lines: list[BaseGeometry]) -> list[Polygon]:
    """Return the polygons that lines enclose."""
    if not lines:
        return []
    parts = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    return [part for part in parts if isinstance(part, Polygon) and part.area > _OFF_M * _MEET_M]


def _left_over(lines: list[PlaneLine], shapes: list[Polygon]) -> list[PlaneLine]:
    """Return the lines that are no polygon's border."""
    borders = shapely.union_all([shape.boundary for shape in shapes])
    left = []
    for line in lines:
        points = shapely.points(
            line.ends[0] + np.array([[0.2], [0.5], [0.8]]) * (line.ends[1] - line.ends[0])
        )
        if borders.is_empty or np.count_nonzero(shapely.distance(borders, points) > _OFF_M) >= 2:
            left.append(line)
    return left


def _strip(line: PlaneLine, painter: Painter) -> Polygon:
    """Return a narrow strip below a line, or beside one that stands."""
    width = painter.between(*_STRIP_M)
    way = line.ends[1] - line.ends[0]
    aside = np.array([way[1], -way[0]]) / np.hypot(*way)
    if abs(way[0]) > abs(way[1]) and aside[1] > 0.0:
        aside = -aside
    return Polygon([*line.ends, *(line.ends[::-1] + width * aside)])


def _kind(shape: Polygon, lines: list[PlaneLine]) -> str:
    """Return the kind of most of the lines on a polygon's border; nothing where there are none."""
    border = shape.boundary
    votes: Counter[str] = Counter()
    for line in lines:
        points = line.ends[0] + np.array([[0.2], [0.5], [0.8]]) * (line.ends[1] - line.ends[0])
        on = np.count_nonzero(shapely.distance(border, shapely.points(points)) <= _OFF_M)
        if on:
            votes[line.kind.lower()] += int(on)
    return votes.most_common(1)[0][0] if votes else ""
