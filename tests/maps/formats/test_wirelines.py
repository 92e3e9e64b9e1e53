"""Doubled and collinear lines become one; names become unique."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maps.formats.wirelines import SAME_LINE_M, WireLine, tidy, uniquely_named


def line(name, p0, p1, kind="edge", sigma=None):
    return WireLine(name, kind, p0, p1, sigma)


def test_pieces_that_touch_or_overlap_are_joined_under_the_longest_ones_name():
    pieces = [
        line("short", (0, 0, 0), (1, 0, 0), "door", 0.1),
        line("long", (5, 0, 0), (1, 0, 0), "floor"),
        line("over", (4.5, 0.002, 0), (6, 0.002, 0)),
    ]
    [joined] = tidy(pieces)
    assert (joined.name, joined.kind, joined.sigma_m) == ("long", "floor", 0.1)
    assert sorted([joined.p0[0], joined.p1[0]]) == pytest.approx([0.0, 6.0])


@pytest.mark.parametrize(
    "other",
    [
        ((1.3, 0, 0), (2, 0, 0)),  # a gap
        ((0, 0.02, 0), (1, 0.02, 0)),  # a door frame's second edge
        ((0, 0, 0), (0.9, 0.2, 0)),  # another direction from the same corner
        ((0, 0, 1), (1, 0, 1)),  # above it
    ],
)
def test_what_is_not_the_same_edge_is_kept(other):
    assert len(tidy([line("a", (0, 0, 0), (1, 0, 0)), line("b", *other)])) == 2


def test_crumbs_are_left_out():
    assert tidy([line("a", (0, 0, 0), (0.01, 0, 0)), line("b", (1, 1, 1), (1, 1, 1))]) == []


@given(
    start=st.tuples(*3 * [st.floats(-50, 50)]),
    way=st.tuples(*3 * [st.floats(-1, 1)]).filter(lambda w: np.linalg.norm(w) > 0.1),
    cuts=st.lists(st.floats(0.5, 9.5), min_size=0, max_size=4),
    flips=st.lists(st.booleans(), min_size=5, max_size=5),
)
def test_a_line_cut_in_pieces_that_run_either_way_is_whole_again(start, way, cuts, flips):
    way = np.array(way) / np.linalg.norm(way)
    stops = [0.0, *sorted(cuts), 10.0]
    pieces = []
    for low, high, flip in zip(stops[:-1], stops[1:], flips, strict=False):
        ends = [tuple((np.array(start) + t * way).tolist()) for t in (low, high)]
        pieces.append(line("x", *(ends[::-1] if flip else ends)))
    [whole] = tidy(pieces)
    assert np.linalg.norm(np.subtract(whole.p1, whole.p0)) == pytest.approx(10.0, abs=2 * SAME_LINE_M)


def test_names_become_unique_and_first_ones_stay():
    lines = [line(name, (0, 0, 0), (1, 0, 0)) for name in ("a", "a.2", "a", "b", "a")]
    names = [entry.name for entry in uniquely_named(lines)]
    assert len(set(names)) == 5
    assert (names[0], names[1], names[3]) == ("a", "a.2", "b")
