"""The hall of the synthetic experiment: 65 edges, 18 x 12 m, as the paper says; the rest is this project's.

Twelve corners of which four are reflex, three oblique walls, three doors and five windows. No two features are
of one size, so that a wrong pose is an error of the method and not a look-alike of the building.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from maps.mapdocument import FloorPart, MapDocument, Segment
from maps.mapfile import build_map
from maps.wiremap import WireMap

Point = tuple[float, float]

CEILING_M = 3.0
#: Counter-clockwise, the floor on the left; wall k leads from corner k to the next.
CORNERS: tuple[Point, ...] = (
    (0.0, 0.0),
    (7.0, 0.0),
    (7.0, 2.0),
    (10.5, 2.0),
    (11.5, 0.0),
    (18.0, 0.0),
    (18.0, 7.0),
    (16.0, 9.0),
    (16.0, 12.0),
    (6.0, 12.0),
    (4.0, 10.5),
    (0.0, 10.5),
)
#: Wall, from and to along it [m], top [m].
DOORS = ((4, 1.2, 2.1, 2.05), (7, 1.0, 2.4, 2.3), (8, 6.2, 7.2, 2.1))
#: Wall, from and to along it, sill and head [m].
WINDOWS = (
    (0, 1.5, 4.1, 0.9, 2.2),
    (4, 3.4, 5.6, 1.0, 2.4),
    (5, 1.6, 4.9, 0.8, 2.1),
    (8, 1.8, 3.6, 1.1, 2.3),
    (11, 3.3, 6.0, 0.7, 2.0),
)


@cache
def hall_map() -> WireMap:
    """Return the hall as a wire map."""
    return build_map(hall_document(), Path("hall"))


def hall_document() -> MapDocument:
    """Return the hall as the contents of a map.yaml."""
    segments = [edge for wall in range(len(CORNERS)) for edge in _wall_edges(wall)]
    segments += [edge for number, door in enumerate(DOORS) for edge in _door_edges(f"door{number}", *door)]
    segments += [
        edge for number, window in enumerate(WINDOWS) for edge in _window_edges(f"window{number}", *window)
    ]
    return MapDocument(segments=segments, floor=[FloorPart(outer=list(CORNERS))])


def _wall_edges(wall: int) -> list[Segment]:
    """The upright edge at a wall's start, and its lower and upper edges."""
    (x0, y0), (x1, y1) = CORNERS[wall], CORNERS[(wall + 1) % len(CORNERS)]
    return [
        Segment(name=f"corner{wall}", kind="corner", p0=(x0, y0, 0.0), p1=(x0, y0, CEILING_M)),
        Segment(name=f"floor{wall}", kind="floor", p0=(x0, y0, 0.0), p1=(x1, y1, 0.0)),
        Segment(name=f"ceiling{wall}", kind="ceiling", p0=(x0, y0, CEILING_M), p1=(x1, y1, CEILING_M)),
    ]


def _door_edges(name: str, wall: int, start: float, end: float, top: float) -> list[Segment]:
    left, right = _along(wall, start), _along(wall, end)
    return [
        Segment(name=f"{name}/left", kind="door", p0=(*left, 0.0), p1=(*left, top)),
        Segment(name=f"{name}/right", kind="door", p0=(*right, 0.0), p1=(*right, top)),
        Segment(name=f"{name}/head", kind="door", p0=(*left, top), p1=(*right, top)),
    ]


def _window_edges(name: str, wall: int, start: float, end: float, sill: float, head: float) -> list[Segment]:
    left, right = _along(wall, start), _along(wall, end)
    return [
        Segment(name=f"{name}/left", kind="window", p0=(*left, sill), p1=(*left, head)),
        Segment(name=f"{name}/right", kind="window", p0=(*right, sill), p1=(*right, head)),
        Segment(name=f"{name}/sill", kind="window", p0=(*left, sill), p1=(*right, sill)),
        Segment(name=f"{name}/head", kind="window", p0=(*left, head), p1=(*right, head)),
    ]


def _along(wall: int, distance: float) -> Point:
    """A point of a wall's foot, metres from its start."""
    (x0, y0), (x1, y1) = CORNERS[wall], CORNERS[(wall + 1) % len(CORNERS)]
    length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
    share = distance / length
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
