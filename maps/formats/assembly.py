"""From a plan to the content of map.yaml."""

from __future__ import annotations

from typing import Any

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from maps.formats.floors import MIN_HOLE_M2, floor_entries, largest_floor
from maps.formats.imported import GUESSED_SIGMA_M, Report
from maps.formats.plan import Opening, Plan
from maps.formats.walls import wall_lines
from maps.formats.wirelines import WireLine, tidy


def map_of_plan(plan: Plan) -> tuple[dict[str, Any], Report]:
    """Return the content of map.yaml for a plan, and what of the plan was left out.

    Every wall facing the floor gives its edge on the floor, at the ceiling and at its corners; cells and
    openings give theirs. Only the largest connected floor is kept.
    """
    plan, report = _largest(plan)
    lines, lintels = wall_lines(plan)
    lines += [line for opening in plan.openings for line in _frame(opening, plan.guessed_openings)]
    whole = tidy(lines)
    content = {
        "segments": [line.entry() for line in whole],
        "floor": floor_entries(plan.floor, _low_parts(plan)),
        "lintels": lintels,
    }
    return content, report


def _largest(plan: Plan) -> tuple[Plan, Report]:
    """Keep what belongs to the largest connected floor."""
    floor, report = largest_floor(plan.floor)
    near = floor.buffer(1e-3)
    kept = MultiPolygon([room for room in plan.rooms.geoms if near.intersects(room.representative_point())])
    around = floor.buffer(0.3)
    return (
        Plan(
            _without_pinholes(kept),
            plan.height_m,
            tuple(cell for cell in plan.passages if near.intersects(cell.polygon.representative_point())),
            tuple(cell for cell in plan.cells if near.intersects(cell.polygon)),
            tuple(o for o in plan.openings if shapely.intersects(around, shapely.linestrings([o.p0, o.p1]))),
            plan.named_rooms,
            plan.guessed_ceiling,
            plan.guessed_openings,
        ),
        report,
    )


def _without_pinholes(rooms: MultiPolygon) -> MultiPolygon:
    solid = [
        Polygon(room.exterior, [ring for ring in room.interiors if Polygon(ring).area >= MIN_HOLE_M2])
        for room in rooms.geoms
    ]
    return MultiPolygon([orient(room) for room in solid])


def _low_parts(plan: Plan) -> list[tuple[Polygon, float]]:
    return [
        (orient(cell.polygon), cell.spans[0][1])
        for cell in plan.cells
        if cell.kind == "low" and cell.polygon.area >= MIN_HOLE_M2
    ]


def _frame(opening: Opening, guessed: bool) -> list[WireLine]:
    """Return the edges of an opening; level ones as uncertain as their height."""
    (x0, y0), (x1, y1), low, high = opening.p0, opening.p1, opening.bottom_m, opening.top_m
    level = GUESSED_SIGMA_M if guessed else None
    name, kind = opening.name, opening.kind
    lines = [
        WireLine(f"{name}/jamb0", kind, (x0, y0, low), (x0, y0, high)),
        WireLine(f"{name}/jamb1", kind, (x1, y1, low), (x1, y1, high)),
        WireLine(f"{name}/head", kind, (x0, y0, high), (x1, y1, high), level),
    ]
    if low > 0.0:
        lines.append(WireLine(f"{name}/sill", kind, (x0, y0, low), (x1, y1, low), level))
    return lines
