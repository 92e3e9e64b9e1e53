"""A toy building, as map.yaml text and as the grey faces that a camera would see.

An L-shaped room with a pillar and a low box; a door opening, with a lintel on both faces of its wall, to
a second room; a window with a recess; dark panels on the walls.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maps.mapfile import read_map
from maps.poses import Array
from maps.wiremap import WireMap

Point = tuple[float, float]
Edge = tuple[Point, Point]

HEIGHT_M, DOOR_M, BOX_M, RECESS_M = 3.0, 2.1, 0.75, 0.09
WINDOW_X, WINDOW_Z, DOOR_Y = (2.0, 4.0), (0.9, 2.1), (1.0, 2.0)
ROOM: list[Point] = [(0, 0), (8, 0), (8, 4), (5, 4), (5, 7), (0, 7)]
SECOND: list[Point] = [(8.2, -1), (12, -1), (12, 4), (8.2, 4)]
PASSAGE: list[Point] = [(8, 1), (8.2, 1), (8.2, 2), (8, 2)]
PILLAR: list[Point] = [(3, 2.5), (3.4, 2.5), (3.4, 2.9), (3, 2.9)]
BOX: list[Point] = [(6, 2.6), (6.8, 2.6), (6.8, 3.4), (6, 3.4)]
#: Panels on the walls: the lower edge in plan, from z to z.
PANELS: dict[str, tuple[Point, Point, float, float]] = {
    "notice": ((0.002, 6.0), (0.002, 4.6), 0.9, 2.0),
    "hatch": ((0.002, 2.0), (0.002, 1.1), 0.0, 2.0),
    "board": ((5.2, 0.002), (6.9, 0.002), 1.0, 2.1),
    "poster": ((7.6, 3.998), (6.4, 3.998), 1.2, 1.9),
    "picture": ((4.998, 4.7), (4.998, 6.1), 1.1, 2.2),
    "cupboard": ((3.6, 6.998), (1.4, 6.998), 0.0, 1.7),
    "screen": ((11.998, 0.0), (11.998, 1.6), 1.0, 2.2),
    "shelf": ((8.9, -0.998), (10.8, -0.998), 0.4, 1.9),
    "mirror": ((11.0, 3.998), (9.2, 3.998), 0.7, 2.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A flat rectangle: `corner`, and two sides from it, metres in the map frame; its grey level."""

    corner: Array
    sides: Array
    grey: int


@dataclass(frozen=True, slots=True)
class Building:
    """What a map file says and what a camera sees of the same place."""

    segments: list[dict[str, object]]
    floor: list[dict[str, object]]
    lintels: list[dict[str, object]]
    faces: list[Face]

    def text(self) -> str:
        """Return the map.yaml; JSON is YAML."""
        return json.dumps(
            {"units": "m", "segments": self.segments, "floor": self.floor, "lintels": self.lintels}
        )

    def read(self, folder: Path) -> WireMap:
        """Write map.yaml into the folder and read it with the project's reader."""
        path = folder / "map.yaml"
        path.write_text(self.text())
        return read_map(path)


def toy_building() -> Building:
    """Return the toy building."""
    lintel = [_lintel("door/west", 8.0), _lintel("door/east", 8.2)]
    floor: list[dict[str, object]] = [
        {"outer": ROOM, "holes": [PILLAR, BOX], "hole_tops_m": [None, BOX_M]},
        {"outer": PASSAGE},
        {"outer": SECOND},
    ]
    return Building(_toy_segments(), floor, lintel, _toy_faces())


def hall(panels: list[float], length_m: float = 14.0) -> Building:
    """Return a plain hall, 6 m wide along x, with equal panels that begin at these x on its far wall."""
    outer: list[Point] = [(0, 0), (length_m, 0), (length_m, 6), (0, 6)]
    segments = _room_edges("hall", outer, [])
    faces = [_level((-5, -5), (30, 30), 0.0, 90), _level((-5, -5), (30, 30), HEIGHT_M, 235)]
    faces += [
        _upright(p, q, 0.0, HEIGHT_M, grey)
        for (p, q), grey in zip(_sides(outer), (150, 185, 165, 200), strict=True)
    ]
    for count, x in enumerate(panels):
        edge = ((x + 0.3, 5.998), (x, 5.998))
        segments += _outline(f"panel{count}", edge, 0.8, 1.6)
        faces.append(_upright(*edge, 0.8, 1.6, 70))
    return Building(segments, [{"outer": outer}], [], faces)


def _toy_segments() -> list[dict[str, object]]:
    west, east = ((8.0, DOOR_Y[0]), (8.0, DOOR_Y[1])), ((8.2, DOOR_Y[1]), (8.2, DOOR_Y[0]))
    segments = _room_edges("room", ROOM, [west]) + _room_edges("second", SECOND, [east])
    for name, edge in (("door/west", west), ("door/east", east)):
        segments += _outline(name, edge, 0.0, DOOR_M)[1:]
    for name, plan, top in (("pillar", PILLAR, HEIGHT_M), ("box", BOX, BOX_M)):
        segments += _room_edges(name, plan, [], top)
    inner, outer = RECESS_M, ((WINDOW_X[0], 0.0), (WINDOW_X[1], 0.0))
    segments += _outline("window", outer, *WINDOW_Z)
    segments += _outline("window/sash", ((WINDOW_X[0], -inner), (WINDOW_X[1], -inner)), *WINDOW_Z)
    for name, (p, q, low, high) in PANELS.items():
        segments += _outline(name, (p, q), low, high)[0 if low else 1 :]
    return segments


def _toy_faces() -> list[Face]:
    faces = [_level((-5, -5), (20, 20), 0.0, 90), _level((-5, -5), (20, 20), HEIGHT_M, 235)]
    for plan, greys in ((ROOM, (150, 0, 165, 200, 140, 190)), (SECOND, (170, 145, 190, 0))):
        faces += [_upright(p, q, 0, HEIGHT_M, grey) for (p, q), grey in zip(_sides(plan), greys, strict=True)]
    faces = [face for face in faces if face.grey and not (face.grey == 150 and face.corner[1] == 0.0)]
    low, high = DOOR_Y
    for x, ends, grey in ((8.0, (0, 4), 185), (8.2, (-1, 4), 160)):
        faces += [
            _upright((x, ends[0]), (x, low), 0, HEIGHT_M, grey),
            _upright((x, high), (x, ends[1]), 0, HEIGHT_M, grey),
            _upright((x, low), (x, high), DOOR_M, HEIGHT_M, grey),
        ]
    faces += [
        _upright((8, low), (8.2, low), 0, DOOR_M, 125),
        _upright((8, high), (8.2, high), 0, DOOR_M, 125),
    ]
    faces.append(_level((8, low), (8.2, high), DOOR_M, 110))
    (left, right), (sill, head) = WINDOW_X, WINDOW_Z
    faces += [
        _upright((0, 0), (left, 0), 0, HEIGHT_M, 150),
        _upright((right, 0), (8, 0), 0, HEIGHT_M, 150),
        _upright((left, 0), (right, 0), 0, sill, 150),
        _upright((left, 0), (right, 0), head, HEIGHT_M, 150),
        _upright((left, -RECESS_M), (right, -RECESS_M), sill, head, 250),
        _upright((left, 0), (left, -RECESS_M), sill, head, 205),
        _upright((right, 0), (right, -RECESS_M), sill, head, 205),
        _level((left, -RECESS_M), (right, 0), sill, 215),
        _level((left, -RECESS_M), (right, 0), head, 110),
    ]
    for plan, top, greys in ((PILLAR, HEIGHT_M, (110, 60, 125, 45)), (BOX, BOX_M, (40, 75, 50, 20))):
        faces += [_upright(p, q, 0, top, grey) for (p, q), grey in zip(_sides(plan), greys, strict=True)]
    faces.append(_level(BOX[0], BOX[2], BOX_M, 130))
    shades = (60, 75, 55, 90, 50, 70, 40, 85, 65)
    faces += [_upright(*panel, grey) for panel, grey in zip(PANELS.values(), shades, strict=True)]
    return faces


def _sides(plan: list[Point]) -> list[Edge]:
    return list(zip(plan, [*plan[1:], plan[0]], strict=True))


def _segment(name: str, kind: str, p0: tuple[float, ...], p1: tuple[float, ...]) -> dict[str, object]:
    return {"name": name, "kind": kind, "p0": p0, "p1": p1}


def _room_edges(
    name: str, plan: list[Point], doors: list[Edge], top: float = HEIGHT_M
) -> list[dict[str, object]]:
    """Return the upright corners, the lower edges but for doors, and the upper edges of a prism."""
    found = []
    for count, (p, q) in enumerate(_sides(plan)):
        found.append(_segment(f"{name}/corner{count}", "corner", (*p, 0.0), (*p, top)))
        found.append(_segment(f"{name}/top{count}", "ceiling", (*p, top), (*q, top)))
        stops = [p, q]
        for door in doors:
            if all(end[0] == p[0] == q[0] for end in door):
                stops = [p, *door, q]
        for part in range(0, len(stops), 2):
            ends = stops[part : part + 2]
            found.append(_segment(f"{name}/floor{count}.{part}", "floor", (*ends[0], 0.0), (*ends[1], 0.0)))
    return found


def _outline(name: str, edge: Edge, low: float, high: float) -> list[dict[str, object]]:
    """Return the four edges of an upright rectangle, the lower one first."""
    p, q = edge
    return [
        _segment(f"{name}/low", "panel", (*p, low), (*q, low)),
        _segment(f"{name}/high", "panel", (*p, high), (*q, high)),
        _segment(f"{name}/left", "panel", (*p, low), (*p, high)),
        _segment(f"{name}/right", "panel", (*q, low), (*q, high)),
    ]


def _lintel(name: str, x: float) -> dict[str, object]:
    return {"name": name, "p0": (x, DOOR_Y[0]), "p1": (x, DOOR_Y[1]), "bottom_m": DOOR_M}


def _upright(p: Point, q: Point, low: float, high: float, grey: int) -> Face:
    sides = np.array([[q[0] - p[0], q[1] - p[1], 0.0], [0.0, 0.0, high - low]])
    return Face(np.array([*p, low], float), sides, grey)


def _level(p: Point, q: Point, z: float, grey: int) -> Face:
    return Face(np.array([*p, z], float), np.diag([q[0] - p[0], q[1] - p[1], 0.0])[:2], grey)
