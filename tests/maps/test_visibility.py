"""Visibility against sight lines cut with the floor plan, point by point; and the cases worth a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, MultiPoint
from toy_building import BOX_M, DOOR_M, toy_building

from maps.poses import Array
from maps.visibility import visible_spans
from maps.wiremap import WireMap

#: Closer than this to a change, in metres on the segment, brute force and clipping may differ.
EDGE_M = 0.03


def seen(wire_map: WireMap, eye: tuple[float, float, float], name: str) -> Array:
    """Return the visible spans (P, 2) of one segment."""
    return visible_spans(wire_map, np.array(eye), np.array([wire_map.names.index(name)]))[1]


def blocked(wire_map: WireMap, eye: Array, point: Array, grow_m: float) -> bool:
    """Whether solid matter, grown by so much, lies on the sight line."""
    line = LineString([eye[:2], point[:2]])
    if line.length < 1e-6:
        return False
    low = wire_map.walls[np.isfinite(wire_map.wall_tops_m)]
    box = MultiPoint(low.reshape(-1, 2)).convex_hull

    def heights(part: shapely.Geometry) -> Array:
        along = [line.project(shapely.Point(p)) / line.length for p in shapely.get_coordinates(part)]
        result: Array = eye[2] + np.array(along) * (point[2] - eye[2])
        return result

    outside = line.difference(wire_map.floor.union(box).buffer(-grow_m))
    if not outside.is_empty:
        return True
    under = line.intersection(box.buffer(grow_m))
    if not under.is_empty and heights(under).min() < BOX_M:
        return True
    for lintel, bottom in zip(wire_map.lintels, wire_map.lintel_bottoms_m, strict=True):
        crossing = line.intersection(LineString(lintel))
        if not crossing.is_empty and heights(crossing).max() > bottom:
            return True
    return False


def test_spans_agree_with_brute_force_at_hundreds_of_points(toy_map: WireMap) -> None:
    rng = np.random.default_rng(4)
    eyes = _places(toy_map, rng, 60)
    rows = np.arange(len(toy_map))
    tally = {True: 0, False: 0}
    for eye in eyes:
        position, spans = visible_spans(toy_map, eye, rows)
        for row in rng.choice(rows, 25, replace=False):
            ends = toy_map.sight_endpoints[row]
            own = spans[position == row]
            slack = EDGE_M / np.linalg.norm(ends[1] - ends[0])
            place = rng.uniform()
            if (np.abs(own - place) < slack).any() or not slack < place < 1.0 - slack:
                continue
            point = ends[0] + place * (ends[1] - ends[0])
            # In the plane of a lintel the two differ on purpose: its own edge is not hidden by it.
            if abs(point[0] - 8.1) < 0.2 and 0.9 < point[1] < 2.1:
                continue
            visible = bool(((own[:, 0] < place) & (place < own[:, 1])).any())
            hidden = {blocked(toy_map, eye, point, grow_m) for grow_m in (-0.01, 0.01)}
            if len(hidden) == 2:  # it grazes a corner
                continue
            assert hidden == {not visible}, (toy_map.names[row], eye, place)
            tally[visible] += 1
    assert min(tally.values()) > 300


def test_spans_are_ordered_disjoint_and_within_the_segment(toy_map: WireMap) -> None:
    for eye in _places(toy_map, np.random.default_rng(5), 50):
        position, spans = visible_spans(toy_map, eye, np.arange(len(toy_map)))
        assert (np.diff(position) >= 0).all()
        assert spans.min() >= 0.0
        assert spans.max() <= 1.0
        assert (spans[:, 1] > spans[:, 0]).all()
        again = np.diff(position) == 0
        assert (spans[1:, 0][again] >= spans[:-1, 1][again]).all()


def test_nothing_is_seen_through_a_wall(toy_map: WireMap) -> None:
    # Round the reflex corner, and the second room away from the door.
    assert len(seen(toy_map, (7.5, 3.5, 1.2), "picture/high")) == 0
    assert len(seen(toy_map, (7.5, 3.5, 1.2), "room/corner4")) == 0
    assert len(seen(toy_map, (1.0, 6.5, 1.2), "screen/high")) == 0
    assert len(seen(toy_map, (9.0, 3.5, 1.2), "notice/high")) == 0


def test_an_empty_room_shows_its_corners_whole(toy_map: WireMap) -> None:
    np.testing.assert_allclose(seen(toy_map, (1.0, 1.0, 1.2), "room/corner0"), [[0.0, 1.0]], atol=1e-9)


def test_the_pillar_cuts_an_edge_in_two(toy_map: WireMap) -> None:
    spans = seen(toy_map, (3.2, 4.5, 1.2), "room/floor0.0")
    assert spans.shape == (2, 2)
    hidden = 8.0 * spans[[0, 1], [1, 0]]
    # Its far corners are at 3.0 and 3.4, 1.6 and 2.0 m ahead; the wall is 4.5 m ahead.
    np.testing.assert_allclose(hidden, 3.2 + 0.2 * 4.5 / 1.6 * np.array([-1, 1]), atol=0.03)


def test_a_low_box_is_looked_over_and_hides_what_is_low_behind_it(toy_map: WireMap) -> None:
    eye = (6.4, 0.5, 1.2)
    np.testing.assert_allclose(seen(toy_map, eye, "poster/low"), [[0.0, 1.0]], atol=1e-6)
    skirting = seen(toy_map, eye, "room/floor2.0")
    assert len(skirting) == 2
    assert not ((skirting[:, 0] < 0.5) & (skirting[:, 1] > 0.5)).any()
    # Its far upper edge is seen from above, and from below its top is not.
    np.testing.assert_allclose(seen(toy_map, eye, "box/top2"), [[0.0, 1.0]], atol=1e-6)
    assert len(seen(toy_map, (6.4, 0.5, 0.5), "box/top2")) == 0
    assert len(seen(toy_map, eye, "box/floor2.0")) == 0


def test_a_lintel_hides_what_is_above_behind_it_but_not_its_own_edge(toy_map: WireMap) -> None:
    eye = (1.0, 1.5, 1.2)
    np.testing.assert_allclose(seen(toy_map, eye, "door/west/high"), [[0.0, 1.0]], atol=1e-6)
    # At the lintel, 7 m ahead, the sight line to the ceiling 11 m ahead is 2.35 m high, that to the
    # screen's upper edge 1.84 m; from 3 m before the lintel the former is 1.97 m high.
    assert len(seen(toy_map, eye, "second/top1")) == 0
    assert len(seen(toy_map, eye, "screen/high")) == 1
    assert len(seen(toy_map, (5.0, 1.5, 1.2), "second/top1")) == 1


def test_a_lintel_hides_what_hangs_close_behind_it(tmp_path: Path) -> None:
    toy = toy_building()
    lamp: dict[str, object] = {"name": "lamp", "p0": (8.6, 1.4, 2.6), "p1": (8.6, 1.6, 2.6)}
    wire_map = replace(toy, segments=[lamp]).read(tmp_path)
    # The sight lines cross the wall at 2.37 m and at 1.84 m.
    assert len(seen(wire_map, (5.0, 1.5, 1.2), "lamp")) == 0
    assert len(seen(wire_map, (7.5, 1.5, 1.2), "lamp")) == 1


@pytest.mark.parametrize("name", ["window/low", "window/high", "window/sash/low", "window/sash/left"])
def test_a_window_recess_is_seen_from_the_room(toy_map: WireMap, name: str) -> None:
    np.testing.assert_allclose(seen(toy_map, (1.5, 2.0, 1.2), name), [[0.0, 1.0]], atol=1e-6)


def test_a_window_is_not_seen_from_the_other_room(toy_map: WireMap) -> None:
    assert len(seen(toy_map, (11.0, 3.0, 1.2), "window/sash/left")) == 0


def test_no_rows_no_spans(toy_map: WireMap) -> None:
    position, spans = visible_spans(toy_map, np.array([1.0, 1.0, 1.2]), np.zeros(0, np.int64))
    assert position.shape == (0,)
    assert spans.shape == (0, 2)


def test_an_eye_on_a_wall_or_a_corner_gives_finite_spans(toy_map: WireMap) -> None:
    for eye in ([0.0, 3.0, 1.2], [8.0, 1.0, 1.2], [5.0, 4.0, 1.2], [6.0, 2.6, BOX_M], [8.1, 1.5, DOOR_M]):
        _, spans = visible_spans(toy_map, np.array(eye), np.arange(len(toy_map)))
        assert np.isfinite(spans).all()
        assert len(spans)


def _places(wire_map: WireMap, rng: np.random.Generator, count: int) -> Array:
    """Return eyes (count, 3) a little inside the floor."""
    inner = wire_map.floor.buffer(-0.05)
    drawn = rng.uniform([0.0, -1.0, 0.4], [12.0, 7.0, 1.8], (20 * count, 3))
    inside = drawn[shapely.contains_xy(inner, drawn[:, 0], drawn[:, 1])]
    return inside[:count]
