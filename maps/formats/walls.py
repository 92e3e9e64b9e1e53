"""The edges of the walls that face a floor: along it, at the ceiling, at corners and openings."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from shapely import STRtree
from shapely.geometry import LineString, Polygon

from maps.formats.imported import GUESSED_SIGMA_M
from maps.formats.plan import Cell, Plan, Spans, merged_spans
from maps.formats.wirelines import WireLine
from maps.poses import Array

#: Walls and cells meet to within this: ten times the precision of the plan.
TOUCH_M = 1e-3
#: A weaker bend is a curve drawn in pieces, where no edge is seen.
MIN_BEND_RAD = math.radians(20.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    """A straight piece of wall, the floor on its left: ends (2,) in plan, what of it is solid."""

    wall: str
    p: Array
    q: Array
    spans: Spans
    cell: Cell | None


def wall_lines(plan: Plan) -> tuple[list[WireLine], list[dict[str, Any]]]:
    """Return the edges of a plan's walls, and the lintels over its passages as map.yaml writes them."""
    beside = (*plan.passages, *plan.cells)
    tree = STRtree([cell.polygon for cell in beside])
    lines: list[WireLine] = []
    lintels: list[dict[str, Any]] = []
    for number, room in enumerate(sorted(plan.rooms.geoms, key=lambda room: -room.area), start=1):
        name = _room_name(plan, room, number)
        for part, ring in enumerate((room.exterior, *room.interiors)):
            corners = np.asarray(shapely.simplify(ring, TOUCH_M).coords)
            around = f"{name}/wall" if part == 0 else f"{name}/block{part}/side"
            faces = [
                face
                for side, ends in enumerate(pairwise(corners), start=1)
                for face in _faces(f"{around}{side}", ends, beside, tree, plan.height_m)
            ]
            lines += _level_lines(faces, plan)
            lines += _upright_lines(faces)
            lintels += [
                {
                    "name": f"{name}/{face.cell.name}",
                    "p0": _xy(face.p),
                    "p1": _xy(face.q),
                    "bottom_m": face.spans[0][0],
                }
                for face in faces
                if face.cell is not None and face.cell in plan.passages and face.spans
            ]
    return lines, lintels


def _room_name(plan: Plan, room: Polygon, number: int) -> str:
    inside = room.representative_point()
    return next((name for polygon, name in plan.named_rooms if polygon.intersects(inside)), f"room{number}")


def _faces(
    wall: str, ends: tuple[Array, Array], beside: tuple[Cell, ...], tree: STRtree, height_m: float
) -> Iterator[_Face]:
    """Cut a straight wall where cells begin and end behind it."""
    p, q = ends
    line = LineString(ends)
    plain: Spans = ((0.0, height_m),)
    cuts: list[tuple[float, float, Cell]] = []
    for row in tree.query(line, predicate="dwithin", distance=TOUCH_M).tolist():
        common = line.intersection(beside[row].polygon.buffer(TOUCH_M, join_style="mitre"))
        for piece in shapely.get_parts(common):
            if isinstance(piece, LineString) and piece.length > 10.0 * TOUCH_M:
                start, stop = sorted(line.project(shapely.Point(end)) for end in piece.coords)
                start += TOUCH_M if start > 0.0 else 0.0
                stop -= TOUCH_M if stop < line.length else 0.0
                cuts.append((start, stop, beside[row]))
    way, reached = (q - p) / line.length, 0.0
    for start, stop, cell in sorted(cuts, key=lambda cut: cut[0]):
        if start > reached + 10.0 * TOUCH_M:
            yield _Face(wall, p + reached * way, p + start * way, plain, None)
        begin = max(start, reached)
        if stop > begin + 10.0 * TOUCH_M:
            yield _Face(wall, p + begin * way, p + stop * way, cell.spans, cell)
            reached = stop
    if reached < line.length - 10.0 * TOUCH_M:
        yield _Face(wall, p + reached * way, q, plain, None)


def _level_lines(faces: list[_Face], plan: Plan) -> Iterator[WireLine]:
    """Where a face begins and ends going up: on the floor, at the ceiling, at an opening's sill and head."""
    for face in faces:
        owner = face.cell.name if face.cell else ""
        room = face.wall.rsplit("/", 1)[0]
        for bottom, top in face.spans:
            for z, what in (
                (bottom, "head"),
                (top, "top" if face.cell and face.cell.kind == "low" else "sill"),
            ):
                sigma = None
                if z == 0.0:
                    name, kind = f"{face.wall}/floor", "floor"
                elif z >= plan.height_m:
                    name, kind = f"{face.wall}/ceiling", "ceiling"
                    sigma = GUESSED_SIGMA_M if plan.guessed_ceiling else None
                elif face.cell is None or face.cell.framed:
                    continue
                else:
                    name, kind = f"{room}/{owner}/{what}", face.cell.kind
                    sigma = GUESSED_SIGMA_M if plan.guessed_openings else None
                yield WireLine(name, kind, (*_xy(face.p), z), (*_xy(face.q), z), sigma)


def _upright_lines(faces: list[_Face]) -> Iterator[WireLine]:
    """Corners, and the sides of openings: where neighbouring faces bend or are not equally solid."""
    for face, following in zip(faces, faces[1:] + faces[:1], strict=True):
        x, y = _xy(face.q)
        if _bend(face, following) >= MIN_BEND_RAD:
            for bottom, top in merged_spans((*face.spans, *following.spans)):
                yield WireLine(f"{face.wall}/corner", "corner", (x, y, bottom), (x, y, top))
            continue
        cells = [side.cell for side in (face, following) if side.cell is not None]
        if not cells or any(cell.framed for cell in cells):
            continue
        room = face.wall.rsplit("/", 1)[0]
        for bottom, top in _in_one_only(face.spans, following.spans):
            kind = "corner" if cells[0].kind == "open" else cells[0].kind
            yield WireLine(f"{room}/{cells[0].name}/jamb", kind, (x, y, bottom), (x, y, top))


def _bend(face: _Face, following: _Face) -> float:
    a, b = face.q - face.p, following.q - following.p
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b)))


def _in_one_only(first: Spans, second: Spans) -> Spans:
    """Return where exactly one of two unions of intervals is solid."""
    levels = sorted({z for span in (*first, *second) for z in span})

    def solid(spans: Spans, z: float) -> bool:
        return any(bottom < z < top for bottom, top in spans)

    pieces = [
        (low, high)
        for low, high in pairwise(levels)
        if solid(first, 0.5 * (low + high)) != solid(second, 0.5 * (low + high))
    ]
    return merged_spans(tuple(pieces))


def _xy(point: Array) -> tuple[float, float]:
    x, y = point.tolist()
    return x, y
