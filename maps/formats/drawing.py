"""The plan that lines of walls, doors and windows mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from maps.errors import InputError
from maps.floor import merged_floor
from maps.formats.arrangement import GRID_M, MAX_SOLIDS, Solid, plan_of_solids
from maps.formats.floors import MIN_HOLE_M2, polygons_of
from maps.formats.imported import LayerKind, LayerRule, Report
from maps.formats.plan import Cell, Opening, Plan
from maps.poses import Array

#: Where nobody says: a door's head; a window's sill and head.
GUESSED_SPANS_M = {LayerKind.DOOR: (0.0, 2.05), LayerKind.WINDOW: (0.9, 2.1)}
#: Areas thinner than this, on average, are walls; wider ones rooms.
MAX_WALL_M = 0.6
#: A door's line is drawn this near to the wall that it belongs to, frames and skirtings included.
NEAR_WALL_M = 0.05
#: Two door lines face each other through a wall when they differ by no more than this.
SAME_DOOR_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Lines (N, 2) in plan, metres; the first point again at the end where one is closed."""

    walls: tuple[Array, ...]
    doors: tuple[Array, ...]
    windows: tuple[Array, ...]


def plan_of_drawing(
    drawing: Drawing, height_m: float, height_told: bool, rules: Mapping[LayerKind, LayerRule], path: Path
) -> tuple[Plan, Report]:
    """Return the plan of a drawing.

    Closed lines of walls are the outline of the free floor, with pillars in it, or the bodies of walls:
    whichever fits the width of what lies between them. `rules`: heights by kind, where somebody told them.
    InputError where no wall line is closed.
    """
    area = _between(drawing.walls)
    if not area.geoms:
        raise InputError(path, "", "no closed line of walls")
    spans, guesses = _spans(drawing, rules)
    openings = [
        opening
        for kind, lines in ((LayerKind.DOOR, drawing.doors), (LayerKind.WINDOW, drawing.windows))
        for opening in _openings(kind, lines, spans[kind])
    ]
    head_m = spans[LayerKind.DOOR][1]
    mean_width = 2.0 * area.area / area.length
    if mean_width > MAX_WALL_M:
        guesses.append(
            f"closed wall lines outline the free floor ({mean_width:.1f} m wide, {area.area:.1f} m2)"
        )
        plan, report = _outlined(area, _doorways(drawing.doors, area.boundary), height_m, head_m)
    else:
        guesses.append(f"closed wall lines are bodies of walls ({mean_width:.2f} m thick)")
        plan, report = _bodies(area, _doorways(drawing.doors, area.boundary), height_m, head_m, path)
    guessed = any(
        kind not in rules for kind, lines in (("door", drawing.doors), ("window", drawing.windows)) if lines
    )
    plan = replace(plan, openings=tuple(openings), guessed_ceiling=not height_told, guessed_openings=guessed)
    closed = sum(bool(np.allclose(line[0], line[-1])) and len(line) > 3 for line in drawing.walls)
    counts: dict[str, int | float] = {
        "closed_wall_lines": closed,
        "wall_total_length_m": round(sum(LineString(line).length for line in drawing.walls), 4),
        "doors": _count_doors(drawing.doors),
        "windows": len(drawing.windows),
        "floor_area_m2": round(plan.floor.area, 4),
    }
    return plan, Report(counts) + report + Report({}, (), tuple(guesses))


def _between(lines: Sequence[Array]) -> MultiPolygon:
    """Return what lies inside of an odd number of closed lines."""
    network = shapely.unary_union([LineString(line) for line in lines], grid_size=GRID_M)
    faces = list(shapely.get_parts(shapely.polygonize([network])))
    rings = [Polygon(line) for line in lines if len(line) > 3 and np.allclose(line[0], line[-1])]
    if not rings:
        # Walls drawn in single strokes: the thin faces between them are the walls.
        thin = [face for face in faces if 2.0 * face.area / face.length < MAX_WALL_M]
        return merged_floor(thin or faces)
    valid = [shapely.make_valid(ring) for ring in rings]
    odd = [
        face for face in faces if sum(ring.intersects(face.representative_point()) for ring in valid) % 2 == 1
    ]
    return merged_floor(odd)


def _spans(
    drawing: Drawing, rules: Mapping[LayerKind, LayerRule]
) -> tuple[dict[LayerKind, tuple[float, float]], list[str]]:
    """Return from where to where doors and windows reach, and sentences where that is guessed."""
    spans, guesses = dict(GUESSED_SPANS_M), []
    for kind, lines in ((LayerKind.DOOR, drawing.doors), (LayerKind.WINDOW, drawing.windows)):
        rule = rules.get(kind)
        if rule is not None and rule.top_m is not None:
            spans[kind] = (rule.bottom_m or 0.0, rule.top_m)
        elif lines:
            low, high = spans[kind]
            guesses.append(
                f"{kind}s reach from {low} to {high} m: tell it with --layer NAME={kind},BOTTOM,TOP"
            )
    return spans, guesses


def _openings(kind: LayerKind, lines: Sequence[Array], span: tuple[float, float]) -> list[Opening]:
    return [
        Opening(f"{kind}{number}", str(kind), _xy(line[0]), _xy(line[-1]), *span)
        for number, line in enumerate(lines, start=1)
        if np.linalg.norm(line[-1] - line[0]) > SAME_DOOR_M
    ]


def _outlined(
    floor: MultiPolygon, doorways: list[Polygon], height_m: float, head_m: float
) -> tuple[Plan, Report]:
    """Return the plan whose floor, passages included, is drawn."""
    under = shapely.unary_union(doorways)
    rooms = merged_floor(polygons_of(floor.difference(under, grid_size=GRID_M)))
    pieces = merged_floor(polygons_of(floor.intersection(under, grid_size=GRID_M)))
    passages = [
        Cell(polygon, ((head_m, height_m),), f"passage{number}", "door", framed=True)
        for number, polygon in enumerate(pieces.geoms, start=1)
        if polygon.area > MIN_HOLE_M2
    ]
    counts: dict[str, int | float] = {"rooms": len(rooms.geoms), "passages": len(passages)}
    return Plan(rooms, height_m, tuple(passages)), Report(counts)


def _bodies(
    walls: MultiPolygon, doorways: list[Polygon], height_m: float, head_m: float, path: Path
) -> tuple[Plan, Report]:
    """Return the plan of walls as bodies, with lintels over the doorways in the gaps between them."""
    solids = [Solid("wall", outline, 0.0, height_m) for outline in walls.geoms]
    for number, gap in enumerate(doorways, start=1):
        # The wall may have a gap there, or not.
        solids.append(Solid(f"passage{number}", gap, 0.0, height_m))
        solids.append(Solid(f"passage{number}", gap, 0.0, head_m, void=True))
    if len(solids) > MAX_SOLIDS:
        raise InputError(path, "", f"more than {MAX_SOLIDS} walls and doors")
    plan, report = plan_of_solids(solids, height_m)
    framed = [
        tuple(replace(c, framed=c.kind == "door") for c in cells) for cells in (plan.passages, plan.cells)
    ]
    return replace(plan, passages=framed[0], cells=framed[1]), report


def _doorways(doors: Sequence[Array], walls: shapely.Geometry) -> list[Polygon]:
    """Return the areas between door lines that face each other through a wall, corners moved to the walls."""
    ends = [np.array([_onto(walls, end) for end in (line[0], line[-1])]) for line in doors]
    areas = []
    for (p0, p1), (q0, q1) in (_alongside(ends[a], ends[b]) for a, b in _pairs(doors)):
        area = Polygon([p0, p1, q1, q0])
        if area.is_valid and area.area > MIN_HOLE_M2:
            areas.append(area)
    return areas


def _alongside(first: Array, second: Array) -> tuple[Array, Array]:
    """Return two segments (2, 2), the second one turned so that it runs like the first one."""
    turned = (first[1] - first[0]) @ (second[1] - second[0]) < 0.0
    return first, second[::-1] if turned else second


def _pairs(doors: Sequence[Array]) -> list[tuple[int, int]]:
    """Pair door lines that are alike and face each other across less than a wall's thickness."""
    pairs: list[tuple[float, int, int]] = []
    for a, first in enumerate(doors):
        for b in range(a):
            one, other = _alongside(first[[0, -1]], doors[b][[0, -1]])
            shift = (other - one).mean(axis=0)
            along = (one[1] - one[0]) / max(float(np.linalg.norm(one[1] - one[0])), 1e-9)
            alike = float(np.abs(other - one - shift).max()) < SAME_DOOR_M
            distance = float(np.linalg.norm(shift))
            if alike and abs(float(shift @ along)) < SAME_DOOR_M and distance < MAX_WALL_M:
                pairs.append((distance, a, b))
    taken: set[int] = set()
    chosen = []
    for _, a, b in sorted(pairs):
        if not {a, b} & taken:
            taken |= {a, b}
            chosen.append((a, b))
    return chosen


def _count_doors(doors: Sequence[Array]) -> int:
    return len(doors) - len(_pairs(doors))


def _onto(walls: shapely.Geometry, point: Array) -> Array:
    """Return the corner of a wall, or the point on it, that a door line's end is drawn near to."""
    at = Point(point)
    corners = shapely.get_coordinates(walls)
    nearest = corners[np.argmin(np.linalg.norm(corners - point, axis=1))]
    if np.linalg.norm(nearest - point) < NEAR_WALL_M:
        return np.asarray(nearest, np.float64)
    on_wall = shapely.shortest_line(at, walls)
    near = on_wall is not None and on_wall.length < NEAR_WALL_M
    return shapely.get_coordinates(on_wall)[1] if near else point


def _xy(point: Array) -> tuple[float, float]:
    x, y = point.tolist()
    return x, y
