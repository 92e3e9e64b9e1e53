"""A building in plan with heights, which is what most formats come down to."""

from __future__ import annotations

from dataclasses import dataclass

from shapely.geometry import MultiPolygon, Polygon

from maps.floor import merged_floor

#: What is solid at one place, from where to where [m], from below up.
Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A piece of the plan beside the rooms that is not simply wall: under a lintel, in a window, a parapet.

    `spans`: what is solid there; nothing at all where a side is open. `kind`: door, window, low or open.
    `framed`: the opening's edges are drawn for themselves, see `Opening`.
    """

    polygon: Polygon
    spans: Spans
    name: str
    kind: str
    framed: bool = False

    @property
    def passable(self) -> bool:
        """Whether a robot could go through."""
        return not self.spans or self.spans[0][0] > 0.0


@dataclass(frozen=True, slots=True)
class Opening:
    """A door's or window's upright rectangle, drawn where it is: ends in plan, and heights [m]."""

    name: str
    kind: str
    p0: tuple[float, float]
    p1: tuple[float, float]
    bottom_m: float
    top_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Rooms, what lies between and beside them, and openings that are drawn for themselves.

    `rooms`: floor but for the passages, which are the cells in `passages`; `cells`: everything else beside
    the rooms that is not wall up to the ceiling. `named_rooms`: names by polygon, where the source has some.
    `guessed_ceiling`, `guessed_openings`: whether these heights are guesses.
    """

    rooms: MultiPolygon
    height_m: float
    passages: tuple[Cell, ...] = ()
    cells: tuple[Cell, ...] = ()
    openings: tuple[Opening, ...] = ()
    named_rooms: tuple[tuple[Polygon, str], ...] = ()
    guessed_ceiling: bool = False
    guessed_openings: bool = False

    @property
    def floor(self) -> MultiPolygon:
        """The navigable floor, passages included."""
        return merged_floor([*self.rooms.geoms, *(cell.polygon for cell in self.passages)])


def merged_spans(spans: Spans, gap_m: float = 0.0) -> Spans:
    """Return the union of intervals, those joined that are nearer than `gap_m`."""
    merged: list[tuple[float, float]] = []
    for bottom, top in sorted(spans):
        if merged and bottom <= merged[-1][1] + gap_m:
            merged[-1] = (merged[-1][0], max(merged[-1][1], top))
        else:
            merged.append((bottom, top))
    return tuple(merged)
