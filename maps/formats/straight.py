"""Straight outlines from outlines of grid cells: few lines, in the building's directions where nearly so."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import LinearRing, Polygon

from maps.formats.floors import polygons_of
from maps.poses import Array

#: In cells: how far an outline may wander off a straight side.
WANDER = 1.5
#: In cells: shorter sides are noise, unless they join two parallel ones that are as far apart.
SHORT = 3.0
#: In cells: how far the end of a side may move when it turns into the building's direction.
TURN = 2.5
#: In cells: how far a corner may move.
SHIFT = 6.0
#: A ring of its own direction (a box put down askew) differs from the building's by more than this.
OWN_DIRECTION_RAD = math.radians(4.0)
#: A side that runs further off the building's directions is not meant to be in them.
MAX_TURN_RAD = math.radians(30.0)
QUARTER = 0.5 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """A straight side: a point on it and its direction (2,), and its end points' corners as drawn (2, 2)."""

    point: Array
    angle: float
    length: float
    ends: Array

    @property
    def way(self) -> Array:
        return np.array([math.cos(self.angle), math.sin(self.angle)])

    @property
    def normal(self) -> Array:
        return np.array([-math.sin(self.angle), math.cos(self.angle)])


def straightened(polygon: Polygon, cell_m: float) -> tuple[Polygon, float]:
    """Return an outline of cells as few straight sides, and the building's direction [rad], in (-pi/4, pi/4].

    `polygon`: outline along the edges of cells of size `cell_m`. Sides near the building's two directions
    are turned into them; every side is the best line through the cells' edges it stands for.
    """
    rings = [polygon.exterior, *polygon.interiors]
    sides = [_sides(ring, cell_m) for ring in rings]
    building = _direction([side for ring in sides for side in ring])
    outlines = []
    for ring, found in zip(rings, sides, strict=True):
        own = _direction(found)
        off = abs(math.remainder(own - building, QUARTER))
        outlines.append(_straight(ring, found, own if off > OWN_DIRECTION_RAD else building, cell_m))
    straight = Polygon(outlines[0], outlines[1:])
    if not straight.is_valid:
        return max(polygons_of(polygon.simplify(WANDER * cell_m)), key=lambda part: part.area), building
    return straight, building


def _sides(ring: LinearRing, cell_m: float) -> list[_Side]:
    """Cut a ring where it bends, and fit a line to each piece."""
    dense = shapely.get_coordinates(ring.segmentize(cell_m * 1.001))
    # The middles of the cells' edges follow a slanting wall; their corners stick out on both sides.
    middles = 0.5 * (dense[:-1] + dense[1:])
    far = int(np.argmax(np.linalg.norm(middles - middles.mean(axis=0), axis=1)))
    middles = np.roll(middles, -far, axis=0)
    closed = np.concatenate([middles, middles[:1]])
    kept = shapely.get_coordinates(shapely.simplify(shapely.linestrings(closed), WANDER * cell_m))
    where = {tuple(point): row for row, point in enumerate(middles.tolist())}
    cuts = [where[tuple(point)] for point in kept.tolist()[:-1]] + [len(middles)]
    return [_fitted(closed[a : b + 1]) for a, b in pairwise(cuts)]


def _fitted(points: Array) -> _Side:
    chord = points[-1] - points[0]
    # The ends belong to the corners as much as to the side.
    inner = points[1:-1] if len(points) > 4 else points
    middle = inner.mean(axis=0)
    along = np.linalg.svd(inner - middle)[2][0] if len(inner) > 2 else chord
    angle = math.atan2(along[1], along[0])
    if along @ chord < 0.0:
        angle += math.pi
    return _Side(middle, angle, float(np.linalg.norm(chord)), points[[0, -1]])


def _direction(sides: Sequence[_Side]) -> float:
    """Return the direction, modulo a quarter turn, in which most of the sides' length runs."""
    angles = np.array([side.angle for side in sides])
    weights = np.array([side.length for side in sides]) ** 2
    candidates = angles % QUARTER
    off = np.abs((candidates[:, None] - candidates[None] + 0.5 * QUARTER) % QUARTER - 0.5 * QUARTER)
    support = (np.maximum(0.0, 1.0 - off / math.radians(6.0)) * weights).sum(axis=1)
    near = off[np.argmax(support)] < math.radians(4.0)
    mean = np.sum(weights[near] * np.exp(4j * angles[near]))
    return float(np.angle(mean)) / 4.0


def _straight(ring: LinearRing, sides: list[_Side], direction: float, cell_m: float) -> Array:
    """Return the corners (N, 2) of a ring's straight sides; those of the ring itself where that fails."""
    turned = [_turned(side, direction, cell_m) for side in sides]
    lines = _joined(turned, cell_m)
    if len(lines) < 3:
        return shapely.get_coordinates(ring.simplify(WANDER * cell_m))
    corners = []
    for line, following in zip(lines, lines[1:] + lines[:1], strict=True):
        drawn = 0.5 * (line.ends[1] + following.ends[0])
        met = _crossing(line, following)
        if met is not None and np.linalg.norm(met - drawn) < SHIFT * cell_m:
            corners.append(met)
        else:
            # Parallel sides: a step at right angles between them.
            corners += [_foot(line, drawn), _foot(following, drawn)]
    outline = np.array(corners)
    whole = Polygon(outline)
    if not whole.is_valid or whole.area < 0.5 * Polygon(ring).area:
        return shapely.get_coordinates(ring.simplify(WANDER * cell_m))
    return outline


def _turned(side: _Side, direction: float, cell_m: float) -> _Side:
    """Turn a side into the building's nearest direction if its ends hardly move."""
    off = math.remainder(side.angle - direction, QUARTER)
    if abs(off) > MAX_TURN_RAD or 0.5 * side.length * abs(math.sin(off)) > TURN * cell_m:
        return side
    return _Side(side.point, side.angle - off, side.length, side.ends)


def _joined(sides: list[_Side], cell_m: float) -> list[_Side]:
    """Join neighbours on one line, and drop short sides, until nothing changes."""
    lines = list(sides)
    changed = True
    while changed and len(lines) > 3:
        changed = False
        for row in range(len(lines)):
            before, line, after = lines[row - 1], lines[row], lines[(row + 1) % len(lines)]
            if _same_line(line, after, cell_m):
                lines[row] = _both(line, after)
                del lines[(row + 1) % len(lines)]
            elif _is_noise(before, line, after, cell_m):
                del lines[row]
            else:
                continue
            changed = True
            break
    return lines


def _is_noise(before: _Side, line: _Side, after: _Side, cell_m: float) -> bool:
    """Whether a side is a ragged or rounded corner, rather than a step between two parallel sides."""
    across = abs(math.remainder(before.angle - after.angle, math.pi)) > math.radians(80.0)
    slanting = abs(math.remainder(line.angle - before.angle, QUARTER)) > math.radians(20.0)
    if across and slanting and line.length < 2.0 * SHORT * cell_m:
        return True
    longer = min(before.length, after.length) >= SHORT * cell_m
    step = longer and _parallel(before, after) and not _same_line(before, after, cell_m)
    return line.length < SHORT * cell_m and not step


def _parallel(a: _Side, b: _Side) -> bool:
    return abs(math.remainder(a.angle - b.angle, math.pi)) < math.radians(10.0)


def _same_line(a: _Side, b: _Side, cell_m: float) -> bool:
    alike = abs(math.remainder(a.angle - b.angle, math.tau)) < math.radians(10.0)
    return alike and abs(float((b.point - a.point) @ a.normal)) < SHORT * cell_m * 0.67


def _both(a: _Side, b: _Side) -> _Side:
    share = a.length / max(a.length + b.length, 1e-9)
    longer = a if a.length >= b.length else b
    # Along the longer one's direction, at the mean of both.
    shift = (share * a.point + (1.0 - share) * b.point - longer.point) @ longer.normal
    point = longer.point + shift * longer.normal
    return _Side(point, longer.angle, a.length + b.length, np.array([a.ends[0], b.ends[1]]))


def _crossing(a: _Side, b: _Side) -> Array | None:
    if _parallel(a, b):
        return None
    reach = np.linalg.solve(np.column_stack([a.way, -b.way]), b.point - a.point)
    return np.asarray(a.point + reach[0] * a.way, np.float64)


def _foot(side: _Side, point: Array) -> Array:
    return np.asarray(side.point + ((point - side.point) @ side.way) * side.way, np.float64)
