"""Pose hypotheses: the true pose among the first, from true and false pairs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, exact_lines, poses_inside, segments_at, window_around

from maps.outcomes import PoseEllipsoid, SearchWindow
from maps.poses import Array, Pose2, wrap_angle
from maps.wiremap import WireMap
from vision.constraints import Correspondences, unary_correspondences
from vision.hypotheses import HypothesisConfig, couple_hypotheses, grid_hypotheses
from vision.projection import Projector

CONFIG = HypothesisConfig()


def cluttered_pairs(
    wire_map: WireMap, pose: Pose2, window: SearchWindow, rng: np.random.Generator
) -> Correspondences:
    """Return the pairs of exact lines and as many random ones again."""
    projector, rows = Projector(CAMERA, wire_map), np.arange(len(wire_map))
    lines = exact_lines(CAMERA, projector.predict(pose, rows))
    starts = rng.uniform([-300, -220], [300, 220], (len(lines), 2))
    stray = np.stack([starts, starts + rng.normal(0.0, 60.0, starts.shape)], axis=1)
    ideal = np.concatenate([lines.ideal_px, stray])
    both = segments_at(ideal)
    predicted = projector.predict(window.centre, rows, CAMERA.focal_px * math.tan(window.dphi_rad))
    return unary_correspondences(CAMERA, wire_map, both, predicted, window)


def within_a_cell(poses: Array, pose: Pose2) -> bool:
    away = np.abs(poses - pose.as_array())
    away[:, 2] = np.abs(wrap_angle(away[:, 2]))
    return bool((away <= [CONFIG.cell_m, CONFIG.cell_m, CONFIG.cell_rad]).all(axis=1).any())


def test_the_true_pose_is_among_the_first_hypotheses(toy_map: WireMap) -> None:
    rng = np.random.default_rng(12)
    first, all_of_them, count = 0, 0, 0
    for pose in poses_inside(toy_map, rng, 70):
        window = window_around(pose, rng, 0.3, math.radians(10.0))
        found = cluttered_pairs(toy_map, pose, window, rng)
        if len(np.unique(found.rows)) < 8:  # it looks at a blank wall
            continue
        poses = couple_hypotheses(CAMERA, found, window, CONFIG)
        first += within_a_cell(poses[:10], pose)
        all_of_them += within_a_cell(poses, pose)
        count += 1
    assert count >= 20
    assert all_of_them == count
    assert first >= 0.9 * count


def test_hypotheses_lie_in_the_window_and_repeat(toy_map: WireMap) -> None:
    rng = np.random.default_rng(13)
    pose = Pose2(5.6, 1.5, math.pi - 0.02)
    window = SearchWindow(Pose2(5.7, 1.4, -math.pi + 0.05), 0.3, math.radians(10.0))
    found = cluttered_pairs(toy_map, pose, window, rng)
    poses = couple_hypotheses(CAMERA, found, window, CONFIG)
    np.testing.assert_array_equal(poses, couple_hypotheses(CAMERA, found, window, CONFIG))
    assert 0 < len(poses) <= CONFIG.max_from_couples
    away = poses - window.centre.as_array()
    assert np.hypot(away[:, 0], away[:, 1]).max() <= window.dt_m + 1e-9
    assert np.abs(wrap_angle(away[:, 2])).max() <= window.dphi_rad + 1e-9
    assert within_a_cell(poses, pose)


def test_hypotheses_keep_to_the_windows_ellipsoid(toy_map: WireMap) -> None:
    pose, centre = Pose2(5.6, 1.5, math.pi - 0.02), Pose2(5.65, 1.45, -math.pi + 0.02)
    disc = SearchWindow(centre, 0.4, math.radians(10.0))
    # Long towards where the pose is, thin across.
    way = np.array([-1.0, 1.0, 0.0]) / math.sqrt(2.0)
    across = np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    covariance = 0.02 * np.outer(way, way) + 0.0004 * np.outer(across, across) + np.diag([0.0, 0.0, 0.0008])
    thin = SearchWindow(centre, disc.dt_m, disc.dphi_rad, PoseEllipsoid(centre, covariance, 9.0))
    # A slice beside the middle is bound by the same ellipsoid.
    beside = replace(thin, centre=Pose2(centre.x, centre.y, centre.phi - 0.05), dphi_rad=0.05)
    found = cluttered_pairs(toy_map, pose, disc, np.random.default_rng(13))
    for window in (thin, beside):
        assert window.ellipsoid is not None
        whole = replace(window, ellipsoid=None)
        couples = couple_hypotheses(CAMERA, found, window, CONFIG)
        assert 0 < len(couples) < len(couple_hypotheses(CAMERA, found, whole, CONFIG))
        assert window.ellipsoid.holds(couples).all()
        # The grid goes on for half a step.
        assert 0 < len(grid_of(window)) < len(grid_of(whole))
        draws = np.random.default_rng(18).multivariate_normal(centre.as_array(), covariance, 200)
        for place in draws:
            if window.holds(Pose2.from_array(place)):
                gap = np.abs(wrap_angle(grid_of(window) - place))
                near = np.hypot(gap[:, 0], gap[:, 1]) <= CONFIG.grid_m
                assert (gap[near, 2] <= CONFIG.grid_rad).any()
    assert within_a_cell(couple_hypotheses(CAMERA, found, thin, CONFIG), pose)
    assert (np.abs(grid_of(thin) - centre.as_array()).max(axis=1) < 1e-12).any()


def grid_of(window: SearchWindow) -> Array:
    return grid_hypotheses(window, CONFIG)


def test_a_sample_of_too_many_couples_repeats_and_still_finds_the_pose(toy_map: WireMap) -> None:
    pose, window = Pose2(2.0, 5.5, -0.9), SearchWindow(Pose2(2.1, 5.4, -0.95), 0.3, math.radians(10.0))
    found = cluttered_pairs(toy_map, pose, window, np.random.default_rng(14))
    few = HypothesisConfig(max_couples=len(found) ** 2 // 4)
    poses = couple_hypotheses(CAMERA, found, window, few)
    np.testing.assert_array_equal(poses, couple_hypotheses(CAMERA, found, window, few))
    assert within_a_cell(poses[:20], pose)


def test_no_pairs_or_only_upright_ones_give_no_hypotheses(toy_map: WireMap) -> None:
    pose = Pose2(2.0, 5.5, -0.9)
    window = SearchWindow(pose, 0.3, 0.17)
    found = cluttered_pairs(toy_map, pose, window, np.random.default_rng(15))
    for keep in (np.zeros(len(found), bool), np.isnan(found.phi)):
        part = Correspondences(
            found.rows[keep],
            found.lines[keep],
            found.phi[keep],
            found.normals_level[keep],
            found.points[keep],
        )
        assert couple_hypotheses(CAMERA, part, window, CONFIG).shape == (0, 3)


def test_the_grid_covers_the_window_evenly() -> None:
    window = SearchWindow(Pose2(1.0, -2.0, 3.0), 0.4, 0.3)
    grid = grid_hypotheses(window, CONFIG)
    away = grid - window.centre.as_array()
    assert np.hypot(away[:, 0], away[:, 1]).max() <= 0.4 + 1e-9
    assert np.abs(away[:, 2]).max() <= 0.3 + 1e-12
    assert (np.abs(away).max(axis=1) < 1e-12).any()
    np.testing.assert_allclose(away.mean(axis=0), 0.0, atol=1e-12)
    rng = np.random.default_rng(16)
    for _ in range(50):
        pose = window_around(window.centre, rng, 0.4, 0.3).centre
        gap = np.abs(wrap_angle(grid - pose.as_array()))
        near = np.hypot(gap[:, 0], gap[:, 1]) <= CONFIG.grid_m
        assert (gap[near, 2] <= 0.5 * CONFIG.grid_rad + 1e-12).any()


def test_the_steps_of_the_grid_are_no_wider_than_asked_for_in_any_window() -> None:
    for dt_m, dphi_rad in ((0.05, 0.01), (0.3, 0.17), (1.0, 0.6)):
        grid = grid_hypotheses(SearchWindow(Pose2(0.0, 0.0, 0.0), dt_m, dphi_rad), CONFIG)
        for axis, step in enumerate((CONFIG.grid_m, CONFIG.grid_m, CONFIG.grid_rad)):
            values = np.unique(grid[:, axis].round(9))
            assert 0.3 * min(step, dt_m) < np.diff(values).max() <= step + 1e-9
            assert values[-1] == -values[0] == pytest.approx((dt_m, dt_m, dphi_rad)[axis])


@pytest.mark.parametrize(("dt_m", "dphi_rad"), [(0.0, 0.0), (0.0, 0.1), (0.2, 0.0)])
def test_a_window_without_width_still_has_its_centre(dt_m: float, dphi_rad: float) -> None:
    window = SearchWindow(Pose2(1.0, -2.0, 3.0), dt_m, dphi_rad)
    assert (np.abs(grid_hypotheses(window, CONFIG) - window.centre.as_array()).max(axis=1) < 1e-12).any()
