"""Vertical lines, their bearings, and the binary constraint on couples of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from paperviews import CAMERA, POINT, WINDOW, Views, exact_camera, views

from maps.outcomes import SearchWindow
from maps.poses import wrap_angle
from vision.camera import Camera
from vision.paper.binary import (
    FIRST_LEFT,
    FIRST_RIGHT,
    arc_distance,
    binary_constraint,
    circle,
    disc_sees,
    subtended,
)
from vision.paper.errors import bearings_of, line_errors
from vision.paper.tables import TableConfig, build_table
from vision.paper.verticals import VerticalRule, leans_as_vertical, through_vanishing_point, vertical_lines

COUNT = 10_000
NOMINAL = math.erf(2.0 / math.sqrt(2.0))


@pytest.mark.parametrize("principal", [True, False])
def test_vertical_lines_are_told_as_surely_as_promised(principal: bool) -> None:
    exact = views(np.random.default_rng(20), COUNT, "upright")
    assert through_vanishing_point(line_errors(exact_camera(), exact.segments), 2.0).all()
    noisy = views(np.random.default_rng(21), COUNT, "upright", noise=1.0, principal=principal)
    kept = through_vanishing_point(line_errors(CAMERA, noisy.segments), 2.0)
    assert kept.mean() == pytest.approx(NOMINAL, abs=0.01)


def test_level_lines_are_not_vertical() -> None:
    seen = views(np.random.default_rng(22), 1000, "level", noise=1.0)
    errors = line_errors(CAMERA, seen.segments)
    for rule, most in ((VerticalRule.VANISHING_POINT, 0.12), (VerticalRule.SLOPE, 0.2)):
        assert len(vertical_lines(CAMERA, seen.segments, errors, 2.0, rule)) < most * 1000


@pytest.mark.parametrize("pitch", [-0.3, 0.0, 0.3])
def test_the_rule_of_slopes_keeps_vertical_edges(pitch: float) -> None:
    # Lines through the vanishing point of a camera that looks up, ahead or down.
    camera = replace(CAMERA, mount=replace(CAMERA.mount, pitch_down_rad=pitch, roll_rad=0.0))
    rays = np.random.default_rng(23).uniform([-300, -200], [300, 200], (500, 2))
    towards = np.array([0.0, camera.focal_px / math.tan(pitch) if pitch else 1e9])
    way = towards - rays
    way /= np.linalg.norm(way, axis=1)[:, None]
    ends = np.stack([rays, rays + 60.0 * way], axis=1)
    segments = views(np.random.default_rng(24), 500, "upright").segments
    segments = replace(segments, ideal_px=ends, raw_px=ends)
    assert leans_as_vertical(camera, segments, 2.0).all()
    if pitch:
        mirrored = replace(camera, mount=replace(camera.mount, pitch_down_rad=-pitch))
        assert not leans_as_vertical(mirrored, segments, 2.0)[np.abs(rays[:, 0]) > 250].any()


def test_bearings_of_exact_vertical_edges_are_right() -> None:
    seen = views(np.random.default_rng(25), COUNT, "upright")
    way = seen.wire_map.endpoints[:, 0, :2] - seen.cameras[:, 1:]
    true = wrap_angle(np.arctan2(way[:, 1], way[:, 0]) - seen.cameras[:, 0])
    np.testing.assert_allclose(bearings_of(CAMERA, seen.segments).bearings, true, atol=2e-7)


def test_bearings_err_as_promised() -> None:
    seen = views(np.random.default_rng(26), COUNT, "upright", noise=1.0)
    way = seen.wire_map.endpoints[:, 0, :2] - seen.cameras[:, 1:]
    true = wrap_angle(np.arctan2(way[:, 1], way[:, 0]) - seen.cameras[:, 0])
    bearings = bearings_of(CAMERA, seen.segments)
    sigma = np.hypot(bearings.own, np.linalg.norm(bearings.shared, axis=1))
    map_sigma = seen.wire_map.sigma_m / np.linalg.norm(way, axis=1)
    off = np.abs(bearings.bearings - true) / np.hypot(sigma, map_sigma)
    assert (off <= 2.0).mean() == pytest.approx(NOMINAL, abs=0.01)


def test_the_circle_passes_through_the_camera() -> None:
    rng = np.random.default_rng(27)
    for ax, ay, bx, by, x, y in rng.uniform(-5.0, 5.0, (COUNT, 6)).tolist():
        angle = subtended(ax, ay, bx, by, x, y)
        assert arc_distance(ax, ay, bx, by, angle, x, y) < 1e-4
        if angle > 0.01:
            cx, cy, radius = circle(ax, ay, bx, by, angle)
            assert math.hypot(x - cx, y - cy) == pytest.approx(radius, rel=1e-6)
            # Equation (4).
            near, far = math.hypot(ax - x, ay - y), math.hypot(bx - x, by - y)
            square = near**2 + far**2 - 2.0 * near * far * math.cos(angle)
            assert (ax - bx) ** 2 + (ay - by) ** 2 == pytest.approx(square, rel=1e-6)


def test_a_negative_angle_is_the_other_order() -> None:
    # From below, an edge further left is on the left.
    assert subtended(0.0, 0.0, 2.0, 0.0, 1.0, -3.0) > 0.0
    assert subtended(0.0, 0.0, 2.0, 0.0, 1.0, 3.0) < 0.0
    assert arc_distance(0.0, 0.0, 2.0, 0.0, 0.5, 1.0, -3.0) < 2.0
    assert arc_distance(0.0, 0.0, 2.0, 0.0, -0.5, 1.0, -3.0) > 3.0


def test_disc_against_all_its_points() -> None:
    rng = np.random.default_rng(28)
    radii, turns = np.sqrt(np.linspace(0.0, 1.0, 40)), np.linspace(-np.pi, np.pi, 90)
    spots = (radii[:, None] * np.exp(1j * turns)[None]).ravel()
    checked = 0
    for ax, ay, bx, by, x, y in rng.uniform(-4.0, 4.0, (400, 6)).tolist():
        angle, slack, radius = rng.uniform(-1.5, 1.5), rng.uniform(0.0, 0.2), rng.uniform(0.1, 1.5)
        places = x + 1j * y + radius * spots
        a, b = ax + 1j * ay, bx + 1j * by
        if min(abs(x + 1j * y - a), abs(x + 1j * y - b)) < radius + 0.1:
            continue
        off = np.abs(wrap_angle(np.angle((a - places) / (b - places)) - angle))
        near = abs(off.min() - slack) < 0.03 or off.min() > np.pi - 0.5
        if not near:
            checked += 1
            assert disc_sees(ax, ay, bx, by, angle, slack, x, y, radius) == (off.min() <= slack)
    assert checked > 200


def shares(seen: Views, camera: Camera, window: SearchWindow) -> tuple[float, float]:
    """The shares of true couples that pass, and that pass with their edges exchanged."""
    bearings = bearings_of(camera, seen.segments)
    kept = exchanged = 0
    count = len(seen.cameras)
    for image in range(count):
        own = np.array([2 * image, 2 * image + 1])
        kept += binary_constraint(seen.wire_map, bearings, own, own, seen.disc, 2.0).couples
        exchanged += binary_constraint(seen.wire_map, bearings, own, own[::-1], seen.disc, 2.0).couples
    assert window.dt_m >= 0.0
    return kept / count, exchanged / count


def test_no_true_couple_of_exact_data_is_rejected_and_exchanged_ones_are() -> None:
    kept, exchanged = shares(
        views(np.random.default_rng(29), COUNT, "upright", each=2), exact_camera(), WINDOW
    )
    assert kept == 1.0
    assert exchanged < 0.1


def test_couples_are_as_sure_as_promised() -> None:
    seen = views(np.random.default_rng(30), COUNT, "upright", noise=1.0, window=POINT, each=2)
    assert shares(seen, CAMERA, POINT)[0] == pytest.approx(NOMINAL, abs=0.01)


def test_noisy_true_couples_pass_in_a_window() -> None:
    seen = views(np.random.default_rng(31), COUNT, "upright", noise=1.0, each=2)
    assert shares(seen, CAMERA, WINDOW)[0] >= 0.94


def test_couples_tell_their_order() -> None:
    seen = views(np.random.default_rng(32), 200, "upright", each=2)
    bearings = bearings_of(exact_camera(), seen.segments)
    for image in range(200):
        own = np.array([2 * image, 2 * image + 1])
        agrees = binary_constraint(seen.wire_map, bearings, own, own, seen.disc, 2.0).agrees
        left = bearings.bearings[own[0]] > bearings.bearings[own[1]]
        assert agrees[0, 1] & (FIRST_LEFT if left else FIRST_RIGHT)
        assert agrees[1, 0] & (FIRST_RIGHT if left else FIRST_LEFT)


def test_edges_and_lines_are_not_coupled_with_themselves() -> None:
    seen = views(np.random.default_rng(33), 1, "upright", each=2)
    bearings = bearings_of(CAMERA, seen.segments)
    rows, lines = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    found = binary_constraint(seen.wire_map, bearings, rows, lines, seen.disc, 2.0)
    assert found.tested == 2
    assert found.agrees[0, 1] == found.agrees[0, 2] == found.agrees[2, 3] == 0
    assert found.agrees[0, 3] != 0


def test_tabulated_tolerances_keep_couples_too() -> None:
    seen = views(np.random.default_rng(34), 2000, "upright", noise=1.0, each=2)
    bearings = bearings_of(CAMERA, seen.segments)
    table = build_table(CAMERA, np.zeros(1), 0.4, TableConfig(angles=4, distances=3))
    kept = 0
    for image in range(2000):
        own = np.array([2 * image, 2 * image + 1])
        kept += binary_constraint(seen.wire_map, bearings, own, own, seen.disc, 2.0, table).couples
    assert kept / 2000 >= 0.94
