"""Shadows against sight lines cut with the rectangles, point by point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.poses import Array
from maps.shadows import hidden_intervals, shadows_of, unhidden_spans

#: Nearer than this to a shadow's border the two may differ.
_GRAZE_M = 1e-6


def edges_and_heights(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rectangles' plan edges (S, 2, 2), either way round, and tops or bottoms (S,)."""
    edges = rng.uniform(-3.0, 3.0, (count, 2, 2))
    return edges, rng.uniform(0.2, 2.5, count)


def covers(edge: Array, height: float, below: bool, eye: Array, points: Array) -> Array:
    """Return how far inside a rectangle sight lines to points (N, 3) pass, metres, negative outside; no margin.

    The least of: the ways to the rectangle's borders, and from the rectangle on to the point.
    """
    way = edge[1] - edge[0]
    length = float(np.hypot(*way))
    normal = np.array([way[1], -way[0]]) / length
    from_eye, beyond = (eye[:2] - edge[0]) @ normal, (points[:, :2] - edge[0]) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        share = from_eye / (from_eye - beyond)
        cross = eye + share[:, None] * (points - eye)
    along = (cross[:, :2] - edge[0]) @ way / length
    upward = height - cross[:, 2] if below else cross[:, 2] - height
    if not math.isfinite(height):
        upward = np.full(len(points), np.inf if below else -np.inf)
    behind = -np.sign(from_eye) * beyond
    inside = np.min([along, length - along, upward, behind], axis=0)
    return np.where((share > 0.0) & (share < 1.0), inside, -np.abs(behind))


def in_shadow(normals: Array, offsets: Array, points: Array) -> Array:
    """Return whether points (N, 3) lie in each shadow, (N, S)."""
    return (np.einsum("spi,ni->nsp", normals, points) > offsets).all(axis=2)


@pytest.mark.parametrize("below", [True, False], ids=["solid below", "solid above"])
def test_shadows_are_where_sight_lines_meet_the_rectangle(below: bool) -> None:
    rng = np.random.default_rng(60)
    tally = {True: 0, False: 0}
    for _ in range(40):
        edges, heights = edges_and_heights(rng, 6)
        eye, points = rng.uniform([-3, -3, 0.2], [3, 3, 2.5]), rng.uniform([-6, -6, 0], [6, 6, 3], (200, 3))
        dark = in_shadow(*shadows_of(edges, eye, 0.0, heights, below), points)
        for number, (edge, height) in enumerate(zip(edges, heights, strict=True)):
            inside = covers(edge, height, below, eye, points)
            clear = np.abs(inside) > _GRAZE_M
            np.testing.assert_array_equal(dark[clear, number], inside[clear] > 0.0)
            for hidden in (True, False):
                tally[hidden] += int((dark[clear, number] == hidden).sum())
    assert min(tally.values()) > 1000


def test_a_wall_without_a_top_hides_at_all_heights_and_a_lintel_without_a_bottom_nowhere() -> None:
    rng = np.random.default_rng(61)
    edges, _ = edges_and_heights(rng, 20)
    eye, points = np.array([0.3, -0.2, 1.2]), rng.uniform([-6, -6, -9], [6, 6, 9], (400, 3))
    endless = np.full(20, np.inf)
    dark = in_shadow(*shadows_of(edges, eye, 0.0, endless, True), points)
    for number, edge in enumerate(edges):
        inside = covers(edge, math.inf, True, eye, points)
        clear = np.abs(inside) > _GRAZE_M
        np.testing.assert_array_equal(dark[clear, number], inside[clear] > 0.0)
    assert dark.sum() > 300
    assert not in_shadow(*shadows_of(edges, eye, 0.0, endless, False), points).any()


def test_what_lies_within_the_margin_behind_is_not_hidden() -> None:
    wall, eye = np.array([[[2.0, -1.0], [2.0, 1.0]]]), np.array([0.0, 0.0, 1.0])
    points = np.array([[x, 0.0, 1.0] for x in (1.0, 1.99, 2.04, 2.06, 5.0)])
    for edges in (wall, wall[:, ::-1]):
        dark = in_shadow(*shadows_of(edges, eye, 0.05, np.array([np.inf]), True), points)
        assert dark[:, 0].tolist() == [False, False, False, True, True]


def some_segments(rng: np.random.Generator, count: int) -> Array:
    return rng.uniform([-6, -6, 0], [6, 6, 3], (count, 2, 3))


def shadows(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    edges, heights = edges_and_heights(rng, count)
    heights[::3] = np.inf
    return shadows_of(edges, rng.uniform([-3, -3, 0.2], [3, 3, 2.5]), 0.01, heights, True)


def test_hidden_intervals_agree_with_points_along_the_segments() -> None:
    rng = np.random.default_rng(62)
    places = (np.arange(500) + 0.5) / 500
    found = 0
    for _ in range(20):
        sight, (normals, offsets) = some_segments(rng, 10), shadows(rng, 8)
        low, high = hidden_intervals(sight, normals, offsets)
        assert low.shape == high.shape == (10, 8)
        for k, (start, end) in enumerate(sight):
            dark = in_shadow(normals, offsets, start + places[:, None] * (end - start))
            for s in range(8):
                np.testing.assert_array_equal((low[k, s] < places) & (places < high[k, s]), dark[:, s])
        found += int((low < high).sum())
    assert found > 100


def test_spans_are_all_that_no_shadow_hides() -> None:
    rng = np.random.default_rng(63)
    places = (np.arange(500) + 0.5) / 500
    split = whole = gone = 0
    for _ in range(30):
        sight, (normals, offsets) = some_segments(rng, 10), shadows(rng, 8)
        which, spans = unhidden_spans(sight, normals, offsets)
        assert (np.diff(which) >= 0).all()
        assert spans.min() >= 0.0
        assert spans.max() <= 1.0
        assert (spans[:, 1] > spans[:, 0]).all()
        for k, (start, end) in enumerate(sight):
            own = spans[which == k]
            assert (own[1:, 0] > own[:-1, 1]).all()
            seen = ((own[:, :1] < places) & (places < own[:, 1:])).any(axis=0)
            dark = in_shadow(normals, offsets, start + places[:, None] * (end - start)).any(axis=1)
            np.testing.assert_array_equal(seen, ~dark)
            split += len(own) > 1
            whole += np.array_equal(own, [[0.0, 1.0]])
            gone += len(own) == 0
    assert min(split, whole, gone) > 10


def test_segments_cut_into_more_pieces_than_room_was_made_for() -> None:
    """A fence of narrow posts leaves a long rail in many pieces."""
    posts = np.array([[[0.1 * n, 1.0], [0.1 * n + 0.02, 1.0]] for n in range(-40, 40)])
    normals, offsets = shadows_of(posts, np.array([0.0, 0.0, 1.0]), 0.0, np.full(80, np.inf), True)
    rails = np.array([[[-12.0, 2.0 + z, z], [12.0, 2.0 + z, z]] for z in (0.0, 0.4, 0.8)])
    which, spans = unhidden_spans(rails, normals, offsets)
    assert np.bincount(which).tolist() == [81, 81, 81]
    # Posts 2 cm wide, twice to 2.8 times as far away.
    hidden = 24.0 * (spans[1:, 0] - spans[:-1, 1])[np.diff(which) == 0]
    np.testing.assert_allclose(hidden, np.repeat([0.04, 0.048, 0.056], 80), atol=1e-9)


def test_without_shadows_all_is_seen_and_without_segments_nothing() -> None:
    rng = np.random.default_rng(64)
    sight = some_segments(rng, 5)
    none = shadows_of(np.zeros((0, 2, 2)), np.zeros(3), 0.0, np.zeros(0), True)
    which, spans = unhidden_spans(sight, *none)
    np.testing.assert_array_equal(which, np.arange(5))
    np.testing.assert_array_equal(spans, np.tile([0.0, 1.0], (5, 1)))
    which, spans = unhidden_spans(sight[:0], *shadows(rng, 3))
    assert which.shape == (0,)
    assert spans.shape == (0, 2)


def test_an_eye_on_a_rectangle_and_an_edge_without_length_give_finite_planes() -> None:
    edges = np.array([[[0.0, 0.0], [2.0, 0.0]], [[1.0, 1.0], [1.0, 1.0]]])
    for eye in ([1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [3.0, 0.0, 1.0], [1.0, 1.0, 1.0]):
        normals, offsets = shadows_of(edges, np.array(eye), 1e-9, np.array([1.0, np.inf]), True)
        assert np.isfinite(normals).all()
        assert np.isfinite(offsets).all()
    # Seen edge on, it hides nothing.
    points = np.random.default_rng(65).uniform([-6, -6, 0], [6, 6, 0.9], (300, 3))
    normals, offsets = shadows_of(edges[:1], np.array([3.0, 0.0, 1.0]), 1e-9, np.array([2.0]), True)
    assert not in_shadow(normals, offsets, points).any()
