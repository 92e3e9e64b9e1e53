"""A robot's parameters from measured lines and wheels, drawn from robots that are somewhat off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measureddrives import measured_drive

from maps.mapfile import read_map
from maps.poses import Pose2
from runs.robotcalibration import conditioned
from runs.robotparameters import names_of
from runs.robotproblem import ROBOT
from runs.robotsolve import Solution, solve, torn
from runs.simulation.paths import DriveKind
from runs.simulation.wheels import TwistErrors

NAMES = names_of(True)
#: What a calibration must reach in the median: metres, radians, seconds; radii and baseline as shares.
REQUIRED = {
    "height_m": 5e-3,
    "pitch_down_rad": np.radians(0.05),
    "yaw_rad": np.radians(0.05),
    "roll_rad": np.radians(0.1),
    "left_radius_m": 0.001 * 0.05,
    "right_radius_m": 0.001 * 0.05,
    "baseline_m": 0.001 * 0.34,
    "time_offset_s": 5e-3,
}


@pytest.fixture(scope="module")
def wire_map(sample):
    return read_map(sample / "map.yaml")


@pytest.fixture(scope="module")
def drive(wire_map):
    return measured_drive(np.random.default_rng(11), wire_map, 80.0, rate_hz=0.5)


@pytest.fixture(scope="module")
def solution(drive):
    return solve(drive.problem, drive.problem.start())


def test_every_slope_is_that_of_small_differences(drive, solution):
    rng = np.random.default_rng(5)
    problem = replace(drive.problem, views=drive.problem.views[:4])
    scale = np.full(problem.unknowns, 1e-3)
    scale[ROBOT - 4 : ROBOT] *= [0.05, 0.05, 0.3, 1.0]
    state = replace(solution.state, frames=solution.state.frames[:4])
    direction = rng.normal(size=problem.unknowns) * scale * 1e-3
    before, after = (problem.blocks(problem.moved(state, sign * direction)) for sign in (-1.0, 1.0))
    for name, block in problem.blocks(state).items():
        change = (after[name].residuals - before[name].residuals).ravel() / 2.0
        expected = block.jacobian @ direction
        if name == "motion":
            # The noise that whitens depends on the parameters a little, and is taken as given.
            np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())
        else:
            np.testing.assert_allclose(change, expected, atol=1e-5 * np.abs(expected).max())


def test_a_drive_with_turns_shows_everything_within_its_deviations(drive, solution):
    off = solution.state.robot - drive.truth
    assert (np.abs(off) < 4.0 * solution.std).all()
    assert (solution.std < 0.5 * drive.problem.prior.std).all()
    # Twice what the median of longer drives must reach.
    for name, limit in REQUIRED.items():
        assert abs(off[NAMES.index(name)]) < 4.0 * limit, name


def test_spreads_tell_the_noise(solution):
    # The lines' noise is as stated; the simulated wheels are noisier than the filter takes them to be.
    assert solution.spreads["lines"] == pytest.approx(0.9, abs=0.15)
    assert 0.9 < solution.spreads["motion"] < 2.0


def test_a_straight_drive_does_not_show_baseline_and_lever_arm(wire_map):
    start = Pose2(2.2, 7.5, 0.0)
    drive = measured_drive(
        np.random.default_rng(12), wire_map, 20.0, DriveKind.STRAIGHT, start=start, rate_hz=1.0
    )
    solution = solve(drive.problem, drive.problem.start())
    shown = dict(zip(NAMES, solution.std < 0.5 * drive.problem.prior.std, strict=True))
    assert not shown["baseline_m"]
    assert not shown["x_m"]
    assert not shown["y_m"]
    assert shown["pitch_down_rad"]
    assert shown["left_radius_m"]
    assert (np.abs(solution.state.robot - drive.truth) < 4.0 * solution.std).all()


def test_twists_have_scales(wire_map):
    errors = TwistErrors(forward_scale=0.04, turn_scale=-0.03, bias_radps=1e-3)
    drive = measured_drive(np.random.default_rng(13), wire_map, 80.0, errors=errors, rate_hz=0.5)
    solution = solve(drive.problem, drive.problem.start())
    off = solution.state.robot - drive.truth
    assert (np.abs(off) < 4.0 * solution.std).all()
    assert (solution.std[6:8] < 0.01).all()


def test_a_frame_matched_elsewhere_is_found(drive):
    views = list(drive.problem.views)
    wrong = len(views) // 2
    taken = views[wrong]
    # All its lines moved as if it looked elsewhere: they agree with each other.
    rays = np.array(taken.seen.rays)
    rays[:, :, 0] += 80.0
    views[wrong] = replace(taken, seen=replace(taken.seen, rays=rays))
    problem = replace(drive.problem, views=tuple(views))
    found = torn(problem, solve(problem, problem.start()), 16.27)
    assert np.flatnonzero(found).tolist() == [wrong]


def test_nothing_is_torn_where_nothing_is_wrong(drive, solution):
    assert not torn(drive.problem, solution, 16.27).any()


def test_what_is_not_shown_keeps_its_prior_and_the_others_follow(drive, solution):
    shown = np.arange(ROBOT) != 8
    values = conditioned(solution, drive.problem.prior, shown)
    assert values[8] == drive.problem.prior.values[8]
    # Held where it was anyway, it changes nothing.
    same = Solution(solution.state, solution.covariance)
    held = replace(drive.problem.prior, values=solution.state.robot)
    np.testing.assert_allclose(conditioned(same, held, shown), solution.state.robot)
    by_hand = solution.covariance[:, 8] / solution.covariance[8, 8] * (values[8] - solution.state.robot[8])
    np.testing.assert_allclose(values, solution.state.robot + by_hand, rtol=1e-9)


@pytest.mark.slow
def test_thirty_robots(wire_map):
    off, ratios = [], []
    for seed in range(30):
        drive = measured_drive(np.random.default_rng(100 + seed), wire_map, 240.0, rate_hz=0.7)
        solution = solve(drive.problem, drive.problem.start())
        off.append(np.abs(solution.state.robot - drive.truth))
        ratios.append(off[-1] / solution.std)
        print(seed, len(drive.problem.views), np.round(ratios[-1], 1))
    median = dict(zip(NAMES, np.median(off, axis=0), strict=True))
    print(median, np.mean(np.array(ratios) < 2.5))
    for name, limit in REQUIRED.items():
        assert median[name] < limit, name
    assert np.mean(np.array(ratios) < 2.5) >= 0.95
