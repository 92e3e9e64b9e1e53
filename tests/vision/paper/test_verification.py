"""Distances, poses and scores of hypotheses."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from paperviews import CAMERA, MOUNT, POINT, WINDOW, Views, exact_camera, views
from scipy.integrate import quad
from scipy.optimize import least_squares

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2, wrap_angle
from vision.camera import Camera
from vision.paper.covariance import pose_covariance, robot_pose
from vision.paper.distance import mean_distance, printed_distance
from vision.paper.errors import line_errors
from vision.paper.leastsquares import (
    Equations,
    best_position,
    equations,
    residuals_and_jacobian,
    solve_pose,
)
from vision.paper.verification import kth_smallest, start_headings


def distance_to_segment(point: Array, p: Array, q: Array) -> float:
    share = np.clip((point - p) @ (q - p) / max((q - p) @ (q - p), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(p + share * (q - p) - point))


def by_quadrature(p: Array, q: Array, s: Array, e: Array) -> float:
    breaks = []
    for end in (p, q):
        slope = (e - s) @ (q - p)
        if abs(slope) > 1e-12:
            breaks.append(float(np.clip((end - s) @ (q - p) / slope, 0.0, 1.0)))
    cross = (q - p)[0] * (e - s)[1] - (q - p)[1] * (e - s)[0]
    if abs(cross) > 1e-12:
        meet = ((p - s)[1] * (q - p)[0] - (p - s)[0] * (q - p)[1]) / cross
        breaks.append(float(np.clip(meet, 0.0, 1.0)))
    stops = [0.0, *sorted(breaks), 1.0]
    return sum(
        quad(lambda t: distance_to_segment(s + t * (e - s), p, q), low, high, epsabs=1e-9)[0]
        for low, high in pairwise(stops)
        if high > low
    )


def test_the_closed_form_is_the_mean_distance() -> None:
    rng = np.random.default_rng(40)
    segments = rng.uniform(-300.0, 300.0, (400, 4, 2))
    segments[:20, 3] = segments[:20, 2] + (segments[:20, 1] - segments[:20, 0]) * 0.3  # parallel
    lean = (segments[20:40, 1] - segments[20:40, 0]) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    segments[20:40, 3] = segments[20:40, 2] + 0.2 * lean  # perpendicular
    segments[40:45, 1] = segments[40:45, 0]  # seen end on
    segments[45:50, 2:] = segments[45:50, :1] + np.array([1.2, 1.5])[:, None] * (
        segments[45:50, 1:2] - segments[45:50, :1]
    )  # collinear, beyond
    for p, q, s, e in segments:
        assert mean_distance(*p, *q, *s, *e) == pytest.approx(by_quadrature(p, q, s, e), rel=1e-6, abs=1e-6)


def test_the_printed_distance_misses_what_is_perpendicular_or_short() -> None:
    assert mean_distance(0.0, 0.0, 300.0, 0.0, 150.0, 100.0, 150.0, 200.0) == pytest.approx(150.0)
    assert printed_distance(0.0, 0.0, 300.0, 0.0, 150.0, 100.0, 150.0, 200.0) == pytest.approx(0.0, abs=1e-9)
    assert mean_distance(0.0, 0.0, 300.0, 0.0, 150.0, 60.0, 160.0, 60.0) == pytest.approx(60.0)
    assert printed_distance(0.0, 0.0, 300.0, 0.0, 150.0, 60.0, 160.0, 60.0) == pytest.approx(2.0)


def test_kth_smallest() -> None:
    values = np.array([5.0, 1.0, 4.0, 2.0, 3.0])
    assert [kth_smallest(values, k) for k in (1, 4, 5, 9)] == [1.0, 4.0, 5.0, 5.0]


def image(seen: Views, camera: Camera, number: int, each: int) -> tuple[Equations, Array]:
    own = np.arange(number * each, (number + 1) * each)
    system = equations(camera, seen.wire_map, line_errors(camera, seen.segments), own, own)
    return system, seen.cameras[number]


def test_jacobian_numerically() -> None:
    system, _ = image(views(np.random.default_rng(41), 1, "sloped", noise=1.0, each=30), CAMERA, 0, 30)
    for state in np.random.default_rng(42).uniform([-3, -2, -2], [3, 6, 6], (20, 3)):
        _, jacobian = residuals_and_jacobian(state, system)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = 1e-6
            up, down = (residuals_and_jacobian(state + side * step, system)[0] for side in (1, -1))
            np.testing.assert_allclose(jacobian[..., axis], (up - down) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("slope", ["level", "sloped"])
def test_exact_lines_give_the_exact_pose(slope: str) -> None:
    seen = views(np.random.default_rng(43), 100, slope, each=6)
    start = np.array([seen.disc.psi, *seen.disc.centre])
    for number in range(100):
        system, true = image(seen, exact_camera(), number, 6)
        cost, *state = solve_pose(system.terms, *start)
        assert cost < 1e-12
        assert abs(wrap_angle(state[0] - true[0])) < 1e-5
        np.testing.assert_allclose(state[1:], true[1:], atol=1e-4)
        # (1.b) is linear in the position.
        np.testing.assert_allclose(best_position(system.terms, true[0], 0.0, 0.0), true[1:], atol=1e-4)


def test_the_least_squares_finds_the_minimum() -> None:
    seen = views(np.random.default_rng(44), 30, "sloped", noise=1.0, each=8)
    start = np.array([seen.disc.psi, *seen.disc.centre])
    for number in range(30):
        system, _ = image(seen, CAMERA, number, 8)
        cost, *_ = solve_pose(system.terms, *start)
        reference = least_squares(lambda x, s=system: residuals_and_jacobian(x, s)[0].ravel(), start)
        assert cost == pytest.approx(2.0 * reference.cost, rel=1e-4)


def test_the_covariance_is_honest() -> None:
    count, each = 600, 7
    nees = []
    seen = views(np.random.default_rng(45), count, "sloped", noise=0.3, window=POINT, each=each)
    camera = views_camera(0.3)
    errors = line_errors(camera, seen.segments)
    for number in range(count):
        own = np.arange(number * each, (number + 1) * each)
        system = equations(camera, seen.wire_map, errors, own, own)
        _, *state = solve_pose(system.terms, *seen.cameras[number])
        covariance = pose_covariance(camera, seen.wire_map, errors, own, own, np.array(state))
        assert covariance is not None
        error = robot_pose(camera, *state).minus(robot_pose(camera, *seen.cameras[number]))
        nees.append(error @ np.linalg.solve(covariance, error))
    assert np.mean(nees) / 3.0 == pytest.approx(1.0, abs=0.12)
    assert np.median(nees) == pytest.approx(2.37, abs=0.35)


def views_camera(noise: float) -> Camera:
    """The camera whose errors are a factor of those stated: what the views were drawn with."""
    from dataclasses import replace

    mount = replace(
        MOUNT,
        std_pitch_down_rad=noise * MOUNT.std_pitch_down_rad,
        std_roll_rad=noise * MOUNT.std_roll_rad,
    )
    return replace(CAMERA, std_focal=noise * CAMERA.std_focal, std_centre_px=noise * 2.0, mount=mount)


def test_parallel_edges_leave_the_position_open() -> None:
    seen = views(np.random.default_rng(46), 1, "upright", each=4)
    ends = seen.wire_map.endpoints.copy()
    errors = line_errors(CAMERA, seen.segments)
    same = np.zeros(4, np.int64)
    state = seen.cameras[0]
    assert ends.shape == (4, 2, 3)
    assert pose_covariance(CAMERA, seen.wire_map, errors, same, same, state) is None


def test_robot_pose_undoes_the_mount() -> None:
    pose = Pose2(1.0, -2.0, 3.0)
    camera = pose @ Pose2(MOUNT.x_m, MOUNT.y_m, MOUNT.yaw_rad)
    back = robot_pose(CAMERA, camera.phi, camera.x, camera.y)
    np.testing.assert_allclose(back.minus(pose), 0.0, atol=1e-12)


def test_starts_cover_a_wide_window() -> None:
    assert start_headings(CAMERA, WINDOW).tolist() == [WINDOW.centre.phi + MOUNT.yaw_rad]
    wide = start_headings(CAMERA, SearchWindow(WINDOW.centre, 9.0, math.pi))
    assert len(wide) >= 3
    np.testing.assert_allclose(np.diff(wide), 2.0 * math.pi / len(wide))
