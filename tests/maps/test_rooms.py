"""Rooms guessed from a floor, their ceilings, and which of them a lost robot may mistake."""

from __future__ import annotations

import math
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely.geometry import Point

from maps.lookalikes import look_alikes
from maps.mapdocument import MapDocument
from maps.mapfile import build_map
from maps.rooms import ceiling_of, rooms_of, vertical
from maps.wiremap import WireMap

Point2 = tuple[float, float]


def prism(name: str, plan: list[Point2], top: float = 3.0) -> list[dict[str, Any]]:
    """Return the upright, lower and upper edges over a plan."""
    edges = []
    for count, (p, q) in enumerate(zip(plan, [*plan[1:], plan[0]], strict=True)):
        edges += [
            {"name": f"{name}/up{count}", "p0": (*p, 0.0), "p1": (*p, top)},
            {"name": f"{name}/low{count}", "p0": (*p, 0.0), "p1": (*q, 0.0)},
            {"name": f"{name}/high{count}", "p0": (*p, top), "p1": (*q, top)},
        ]
    return edges


def build(
    plans: list[list[Point2]], segments: list[dict[str, Any]], lintels: list[dict[str, Any]] | None = None
) -> WireMap:
    content = {
        "segments": segments,
        "floor": [{"outer": plan} for plan in plans],
        "lintels": lintels or [],
    }
    return build_map(MapDocument.model_validate(content), Path("built"))


def rectangle(x: float, y: float, width: float, depth: float) -> list[Point2]:
    return [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]


def turned(plan: list[Point2], quarters: int, by: Point2) -> list[Point2]:
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), quarters)
    return [(float(x), float(y)) for x, y in np.array(plan) @ turn.T + by]


def test_toy_building_has_two_rooms(toy_map: WireMap) -> None:
    first, second = sorted(rooms_of(toy_map), key=lambda room: -room.outline.area)
    # Less pillar, box, and the slot of 0.6 m behind the box.
    assert first.outline.area == pytest.approx(47.0 - 0.16 - 0.64 - 0.48, abs=0.05)
    assert second.outline.area == pytest.approx(19.0, abs=0.05)
    assert len(first.rows) + len(second.rows) == len(toy_map)
    names = {toy_map.names[row].split("/")[0] for row in second.rows}
    assert {"second", "screen", "shelf", "mirror"} <= names
    assert not names & {"room", "pillar", "box", "window", "board", "notice"}
    assert ceiling_of(first, toy_map) == ceiling_of(second, toy_map) == 3.0


@pytest.mark.parametrize(("width", "lintel", "count"), [(0.9, False, 2), (1.6, False, 1), (1.6, True, 2)])
def test_doors_and_lintels_split_rooms_and_wide_openings_do_not(
    width: float, lintel: bool, count: int
) -> None:
    plans = [rectangle(0, 0, 4, 4), rectangle(4.2, 0, 4, 4), rectangle(3.9, 1, 0.4, width)]
    over = [{"p0": [4.1, 1], "p1": [4.1, 1 + width], "bottom_m": 2.0}] if lintel else []
    assert len(rooms_of(build(plans, prism("a", plans[0]), over))) == count


def test_floor_too_narrow_for_a_room_has_none() -> None:
    plan = rectangle(0, 0, 9, 0.8)
    assert rooms_of(build([plan], prism("duct", plan))) == ()


def test_ceiling_is_not_raised_by_one_edge_and_not_lowered_by_doors() -> None:
    plan = rectangle(0, 0, 4, 4)
    doors = [{"p0": (x, 0, 0), "p1": (x, 0, 2.1)} for x in (1, 1.9, 2.2, 3.1)]
    stray = [{"p0": (0, 1, 0), "p1": (0, 1, 7)}, {"p0": (0, 2, 5), "p1": (0, 3, 5)}]
    wire_map = build([plan], prism("a", plan, 2.6) + doors + stray)
    assert ceiling_of(rooms_of(wire_map)[0], wire_map) == pytest.approx(2.6)
    low = build([plan], [{"p0": (0, 1, 1), "p1": (0, 2, 1)}])
    assert ceiling_of(rooms_of(low)[0], low) is None


def test_vertical_leans_by_less_than_a_tenth() -> None:
    edges = np.array([[[0, 0, 0], [0, 0, -2]], [[0, 0, 0], [0.15, 0, 2]], [[0, 0, 0], [0.25, 0, 2]]], float)
    assert vertical(edges).tolist() == [True, True, False]


L_PLAN: list[Point2] = [(0, 0), (5, 0), (5, 2), (3, 2), (3, 4), (0, 4)]


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_congruent_rooms_are_found_with_their_turn(quarters: int) -> None:
    other = turned(L_PLAN, quarters, (20.03, 1.0))
    wire_map = build([L_PLAN, other], prism("a", L_PLAN) + prism("b", other))
    (alike,) = look_alikes(rooms_of(wire_map), wire_map)
    assert {room.outline.contains(Point(1, 1)) for room in alike.rooms} == {True, False}
    from_first = alike.rooms[0].outline.contains(Point(1, 1))
    assert alike.turn_deg == 90 * (quarters if from_first else -quarters % 4)
    assert alike.share == 1.0


def test_mirrored_wider_taller_and_marked_rooms_differ() -> None:
    mirrored = [(30.0 - x, y) for x, y in reversed(L_PLAN)]
    wider = [(40.0 + x * 1.1, y) for x, y in L_PLAN]
    taller = turned(L_PLAN, 0, (50.0, 0.0))
    marked = turned(L_PLAN, 0, (60.0, 0.0))
    plans = [L_PLAN, mirrored, wider, taller, marked]
    marks = [
        {"name": f"mark{row}", "p0": (60.0, y, 0), "p1": (60.0, y, 2)}
        for row, y in enumerate((1, 1.5, 2.5, 3))
    ]
    edges = [prism(f"room{row}", plan, 3.0 + 0.3 * (plan is taller)) for row, plan in enumerate(plans)]
    wire_map = build(plans, [*chain(*edges), *marks])
    assert len(rooms_of(wire_map)) == 5
    assert look_alikes(rooms_of(wire_map), wire_map) == []


def test_a_rectangle_looks_like_itself_until_something_is_on_one_wall() -> None:
    plan = rectangle(0, 0, 4, 3)
    bare = build([plan], prism("a", plan))
    (alike,) = look_alikes(rooms_of(bare), bare)
    assert alike.rooms[0] is alike.rooms[1]
    assert alike.turn_deg == 180
    cupboard = [{"p0": (x, 0, z), "p1": (x, 0, z + 1.9)} for x in (1.0, 2.0, 2.5) for z in (0.0, 0.1)]
    marked = build([plan], prism("a", plan) + cupboard)
    assert math.isclose(rooms_of(marked)[0].outline.area, 12.0)
    assert look_alikes(rooms_of(marked), marked) == []


@pytest.mark.parametrize("marked", [0, 1])
def test_furnished_room_does_not_look_like_a_bare_one(marked: int) -> None:
    plans = [L_PLAN, turned(L_PLAN, 0, (10.0, 0.0))]
    left = 10.0 * marked
    marks = [{"p0": (left, y, 0), "p1": (left, y, 2)} for y in (1, 1.5, 2.5, 3)]
    wire_map = build(plans, prism("a", plans[0]) + prism("b", plans[1]) + marks)
    assert look_alikes(rooms_of(wire_map), wire_map) == []
