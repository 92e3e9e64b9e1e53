"""From solid pieces of a building (walls, parts over doors) and voids in them to its plan.

The outlines of all pieces cut the plan into faces. Over each face the pieces stack up to spans of what is
solid: nothing makes a room, a hanging part a passage or a door, a gap a window, a low part a parapet.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import STRtree, unary_union
from shapely.geometry import LineString, MultiPolygon, Polygon, box

from maps.floor import merged_floor
from maps.formats.floors import polygons_of
from maps.formats.imported import Report, counted
from maps.formats.plan import Cell, Plan, Spans, merged_spans
from maps.poses import Array

#: Outlines are snapped to this grid, so that walls that meet have their corners in common.
GRID_M = 1e-3
#: Parts of a wall that miss each other by less touch.
TOUCH_M = 0.02
#: What hangs higher than this leaves a passage; what ends lower than the step is no obstacle.
MIN_HEADROOM_M = 1.2
MAX_STEP_M = 0.05
#: The widest gap in line with a wall that is taken for a doorway.
MAX_DOORWAY_M = 1.5
#: Smaller closed spaces are shafts, not rooms.
MIN_ROOM_M2 = 0.5
#: The number of pieces is bounded for the sake of time.
MAX_SOLIDS = 5000


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """An upright prism of a building: outline in plan, from where to where [m]; a void cuts it out."""

    name: str
    outline: Polygon
    bottom_m: float
    top_m: float
    void: bool = False


def plan_of_solids(
    solids: Sequence[Solid], height_m: float, rooms: Sequence[tuple[Polygon, str]] = ()
) -> tuple[Plan, Report]:
    """Return the plan of a building made of prisms, and what had to be guessed.

    `rooms`: outlines and names where the source tells them; otherwise what is enclosed, doorways without a
    door counted as closed, is a room; and where nothing is, the hull of everything.
    """
    height_m = round(height_m, 3)
    standing = [solid for solid in solids if solid.bottom_m < height_m and solid.top_m > MAX_STEP_M]
    doorways = _doorways(standing)
    outlines = [*(solid.outline for solid in standing), *doorways, *(outline for outline, _ in rooms)]
    world = box(*unary_union(outlines).buffer(1.0).bounds)
    faces = _faces([*outlines, world])
    tree = _tree(standing)
    spans = [_spans(face, standing, height_m, tree) for face in faces]
    empty = [face for face, solid in zip(faces, spans, strict=True) if not solid]
    free, gaps = _parted(empty, doorways)
    inside, guessed = _rooms(free, world, [outline for outline, _ in rooms])
    outside = _parted(free, list(inside.geoms))[0]
    cells = _cells(faces, spans, standing, height_m)
    cells += [Cell(gap, (), f"gap{number}", "open") for number, gap in enumerate(_united(gaps), start=1)]
    passages = [cell for cell in cells if cell.passable and _joins(cell, inside, unary_union(outside))]
    beside = [cell for cell in cells if cell not in passages]
    # Where nothing hangs over a gap between rooms, it is one room.
    joined = merged_floor([*inside.geoms, *(cell.polygon for cell in passages if not cell.spans)])
    under = tuple(cell for cell in passages if cell.spans)
    plan = Plan(joined, height_m, under, tuple(beside), named_rooms=tuple(rooms))
    counts: dict[str, int | float] = {"rooms": len(joined.geoms), "passages": len(under)}
    for kind, plural in (
        ("door", "outer_doors"),
        ("window", "window_openings"),
        ("low", "parapets"),
        ("open", "open_sides"),
    ):
        counts[plural] = sum(cell.kind == kind for cell in beside)
    if counts["open_sides"]:
        guessed += (f"the floor ends at {counted(int(counts['open_sides']), 'gap')} in line with the walls",)
    return plan, Report(counts, (), guessed)


def _tree(solids: Sequence[Solid]) -> STRtree:
    return STRtree([solid.outline for solid in solids])


def _united(polygons: Sequence[Polygon]) -> list[Polygon]:
    return polygons_of(unary_union(list(polygons)))


def _parted(faces: Sequence[Polygon], areas: Sequence[Polygon]) -> tuple[list[Polygon], list[Polygon]]:
    """Return the faces outside and inside of some areas, whose outlines are among those of the faces."""
    area = unary_union(list(areas))
    shapely.prepare(area)
    within = [area.intersects(face.representative_point()) for face in faces]
    outer = [face for face, inner in zip(faces, within, strict=True) if not inner]
    return outer, [face for face, inner in zip(faces, within, strict=True) if inner]


def _faces(outlines: Sequence[Polygon]) -> list[Polygon]:
    """Return the faces into which the outlines cut the plan."""
    with np.errstate(all="ignore"):
        # Snapping to a grid divides by zero on its way, without harm.
        linework = unary_union([outline.boundary for outline in outlines], grid_size=GRID_M)
    return [face for face in shapely.get_parts(shapely.polygonize([linework])) if face.area > GRID_M**2]


def _spans(face: Polygon, solids: Sequence[Solid], height_m: float, tree: STRtree) -> Spans:
    """Return what is solid over a face, voids taken out, within the room's height."""
    at = face.representative_point()
    here = [solids[row] for row in sorted(tree.query(at, predicate="intersects").tolist())]
    spans = merged_spans(tuple((s.bottom_m, s.top_m) for s in here if not s.void), TOUCH_M)
    for void in (solid for solid in here if solid.void):
        spans = tuple(
            piece
            for bottom, top in spans
            for piece in ((bottom, min(top, void.bottom_m)), (max(bottom, void.top_m), top))
            if piece[1] > piece[0] + TOUCH_M
        )
    standing = [(0.0 if bottom < MAX_STEP_M else bottom, top) for bottom, top in spans if top > MAX_STEP_M]
    whole = [(bottom, height_m if top > height_m - TOUCH_M else top) for bottom, top in standing]
    return tuple((round(bottom, 3), round(top, 3)) for bottom, top in whole if bottom < height_m - TOUCH_M)


def _cells(
    faces: Sequence[Polygon], spans: Sequence[Spans], solids: Sequence[Solid], height_m: float
) -> list[Cell]:
    """Join neighbouring faces with equal spans; walls up to the ceiling are no cells."""
    alike: defaultdict[Spans, list[Polygon]] = defaultdict(list)
    for face, solid in zip(faces, spans, strict=True):
        if solid not in ((), ((0.0, height_m),)):
            alike[solid].append(face)
    tree, counts, cells = _tree(solids), defaultdict[str, int](int), []
    for solid, members in alike.items():
        for polygon in _united(members):
            if polygon.buffer(-0.5 * TOUCH_M).is_empty:
                # A sliver where walls overlap is not worth an opening of its own.
                continue
            at = polygon.representative_point()
            source = max(
                (solids[row] for row in tree.query(at, predicate="intersects").tolist()),
                key=lambda piece: (piece.void, piece.bottom_m),
            )
            kind = _kind(solid, height_m)
            counts[source.name] += 1
            number = f".{counts[source.name]}" if counts[source.name] > 1 else ""
            cells.append(Cell(polygon, solid, f"{source.name}/{kind}{number}", kind))
    return cells


def _kind(spans: Spans, height_m: float) -> str:
    if spans[0][0] >= MIN_HEADROOM_M:
        return "door"
    if len(spans) == 1 and spans[0][0] == 0.0 and spans[0][1] < height_m:
        return "low"
    return "window"


def _rooms(
    free: Sequence[Polygon], world: Polygon, told: Sequence[Polygon]
) -> tuple[MultiPolygon, tuple[str, ...]]:
    """Return the rooms: what the source says, else what is enclosed, else the hull of the walls."""
    if told:
        return _large(_united(_parted(free, told)[1])), ()
    edge = world.boundary
    enclosed = _large([part for part in _united(free) if part.distance(edge) > GRID_M])
    if enclosed.geoms:
        return enclosed, ()
    hull = world.difference(unary_union(list(free))).convex_hull
    guessed = "the walls enclose no room: the floor is what lies within their hull"
    return _large(polygons_of(unary_union(free).intersection(hull))), (guessed,)


def _large(rooms: Sequence[Polygon]) -> MultiPolygon:
    """Return the rooms that are large enough, without the cracks between walls that do not quite meet."""
    opened = merged_floor(list(rooms)).buffer(-0.5 * TOUCH_M, join_style="mitre", mitre_limit=20.0)
    whole = merged_floor(_united([opened.buffer(0.5 * TOUCH_M, join_style="mitre", mitre_limit=20.0)]))
    return MultiPolygon([room for room in whole.geoms if room.area >= MIN_ROOM_M2])


def _doorways(solids: Sequence[Solid]) -> list[Polygon]:
    """Return the gaps that continue a wall on the floor along its axis, up to the next wall."""
    walls = [solid for solid in solids if not solid.void]
    tree = _tree(walls)
    found = []
    for row, wall in enumerate(walls):
        if wall.bottom_m > MAX_STEP_M:
            continue
        for end, way, across in _ends(wall.outline):
            # A little narrower than the wall, so that it does not catch on walls that run alongside.
            sides = [
                LineString([end + s * across, end + s * across + MAX_DOORWAY_M * way]) for s in (-0.4, 0.4)
            ]
            near = [
                walls[k].outline for k in tree.query(box(*unary_union(sides).bounds)).tolist() if k != row
            ]
            reach = max(_clear(side, near) for side in sides)
            if TOUCH_M < reach < MAX_DOORWAY_M:
                corners = [end - 0.5 * across, end + 0.5 * across]
                found.append(Polygon([*corners, corners[1] + reach * way, corners[0] + reach * way]))
    return found


def _ends(outline: Polygon) -> list[tuple[Array, Array, Array]]:
    """Return of a wall's two ends the middle, the unit vector outwards, and the vector across the wall."""
    corners = shapely.get_coordinates(outline.minimum_rotated_rectangle)[:4]
    if len(corners) < 4:
        # So thin that it has no two ends.
        return []
    sides = corners[1] - corners[0], corners[2] - corners[1]
    lengths = [float(np.linalg.norm(side)) for side in sides]
    long = int(lengths[1] > lengths[0])
    way, across = sides[long] / max(lengths[long], 1e-9), sides[1 - long]
    middle = corners.mean(axis=0)
    if math.isclose(lengths[0], lengths[1], rel_tol=0.5):
        return []
    return [(middle + sign * 0.5 * lengths[long] * way, sign * way, across) for sign in (-1.0, 1.0)]


def _clear(ray: LineString, walls: Sequence[Polygon]) -> float:
    """Return how far one can go along a ray before the first wall."""
    start = shapely.Point(ray.coords[0])
    return min(
        (start.distance(ray.intersection(wall)) for wall in walls if ray.intersects(wall)), default=math.inf
    )


def _joins(cell: Cell, rooms: MultiPolygon, outside: shapely.Geometry) -> bool:
    """Whether a passable cell leads from room to room, not out of the building."""
    around = cell.polygon.buffer(2.0 * GRID_M, join_style="mitre")
    shared = 4.0 * GRID_M * TOUCH_M
    return around.intersection(rooms).area > shared and around.intersection(outside).area < shared
