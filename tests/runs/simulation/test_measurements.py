"""What wheels and fixes make of a drive, and sessions of them that the runner takes."""

from __future__ import annotations

import math
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from localization.odometry import OdometryNoise, WheelGeometry, advance
from maps.poses import Pose2, wrap_angle
from runs.config import RunConfig
from runs.robot import Robot
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import Odometry
from runs.simulation.fixes import FixErrors, simulate_fixes
from runs.simulation.offsets import UNCALIBRATED, Offsets, true_robot
from runs.simulation.paths import Drive, DriveKind, simulate_drive
from runs.simulation.synthetic import PLAIN_ROBOT, SessionPlan, simulate_session
from runs.simulation.wheels import (
    EXACT_TWISTS,
    EXACT_WHEELS,
    TwistErrors,
    WheelErrors,
    simulate_encoders,
    simulate_twists,
)
from runs.tracks import errors_of
from vision.camera import Camera, CameraModel, CameraMount

WHEELS = WheelGeometry(0.05, 0.05, 0.34)
CAMERA = Camera(
    CameraModel.PINHOLE_RADTAN, 64, 48, 50.0, 50.0, 31.5, 23.5, np.zeros(5), CameraMount(0.2, 0.1)
)
EYED = Robot(Path("robot.yaml"), WHEELS, CAMERA, 0, None)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate_drive(np.random.default_rng(2), 60.0)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def reckoned(drive: Drive, odometry: Odometry) -> Pose2:
    steps = [step for _, step in odometry.steps(OdometryNoise())]
    return reduce(advance, steps, Pose2.from_array(drive.poses[0]))


def test_exact_wheels_and_twists_reckon_the_truth(drive: Drive) -> None:
    end = Pose2.from_array(drive.poses[-1])
    by_wheels = simulate_encoders(drive, WHEELS, WHEELS, EXACT_WHEELS, rng())
    by_twists = simulate_twists(drive, EXACT_TWISTS, rng())
    for odometry in (by_wheels, by_twists):
        np.testing.assert_allclose(reckoned(drive, odometry).minus(end), 0.0, atol=1e-6)


def test_wheels_that_differ_from_their_file_scale_what_is_reckoned() -> None:
    straight = simulate_drive(rng(1), 30.0, DriveKind.STRAIGHT)
    larger = WheelGeometry(0.0505, 0.0505, 0.34)
    odometry = simulate_encoders(straight, larger, WHEELS, EXACT_WHEELS, rng())
    start, end = Pose2.from_array(straight.poses[0]), reckoned(straight, odometry)
    assert math.hypot(end.x - start.x, end.y - start.y) == pytest.approx(straight.length_m / 1.01)
    turning = simulate_drive(rng(1), 30.0, DriveKind.TURNING)
    wider = simulate_encoders(turning, WheelGeometry(0.05, 0.05, 0.357), WHEELS, EXACT_WHEELS, rng())
    told = (wider.values[:, 1] - wider.values[:, 0]) * 0.05 / 0.34
    truth = np.append(0.0, np.cumsum(turning.steps()[1]))
    np.testing.assert_allclose(told, 1.05 * truth, atol=1e-9)


def test_random_errors_have_the_variance_that_the_filter_is_told() -> None:
    straight = simulate_drive(rng(1), 20.0, DriveKind.STRAIGHT)
    errors = WheelErrors(noise_m2_per_m=1e-4, slips_per_m=0.0, ticks_per_turn=0)
    ends = np.array(
        [simulate_encoders(straight, WHEELS, WHEELS, errors, rng(seed)).values[-1] for seed in range(400)]
    )
    measured = np.var(0.05 * ends - straight.length_m, axis=0)
    np.testing.assert_allclose(measured, 1e-4 * straight.length_m, rtol=0.25)


def test_encoders_count_whole_ticks_and_slips_only_add(drive: Drive) -> None:
    ticks = simulate_encoders(drive, WHEELS, WHEELS, WheelErrors(ticks_per_turn=100), rng()).values
    counts = ticks / (math.tau / 100)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    slipping = WheelErrors(0.0, slips_per_m=1.0, slip_m=0.02, ticks_per_turn=0)
    straight = simulate_drive(rng(1), 30.0, DriveKind.STRAIGHT)
    rolled = 0.05 * simulate_encoders(straight, WHEELS, WHEELS, slipping, rng()).values
    assert (rolled[-1] > straight.length_m * 1.005).all()
    assert (np.diff(rolled, axis=0) >= -1e-12).all()


def test_standing_wheels_say_nothing_and_a_biased_twist_turns() -> None:
    standing = simulate_drive(rng(), 10.0, DriveKind.STANDING)
    assert simulate_encoders(standing, WHEELS, WHEELS, WheelErrors(), rng()).values.max() == 0.0
    biased = simulate_twists(standing, TwistErrors(bias_radps=0.01), rng())
    np.testing.assert_allclose(biased.values[:-1, 1], 0.01)
    assert biased.values[-1].tolist() == [0.0, 0.0]


def test_fixes_err_as_their_covariance_says(drive: Drive) -> None:
    errors = FixErrors(rate_hz=50.0, std_m=0.05, std_rad=0.02, spread=2.0)
    fixes = simulate_fixes(drive, errors, rng()).fixes
    truth = drive.at(np.array([fix.stamp_ns for fix in fixes]))
    poses = np.array([fix.fix.belief.pose.as_array() for fix in fixes])
    deviations = np.sqrt([np.diag(fix.fix.belief.covariance) for fix in fixes])
    normal = (
        np.column_stack([poses[:, :2] - truth[:, :2], wrap_angle(poses[:, 2] - truth[:, 2])]) / deviations
    )
    np.testing.assert_allclose(normal.std(axis=0), 1.0, atol=0.05)
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=0.08)
    assert deviations[:, 0].max() > 1.8 * 0.05
    assert deviations[:, 0].min() < 0.05 / 1.8


def test_outliers_gaps_and_delays(drive: Drive) -> None:
    errors = FixErrors(rate_hz=10.0, outlier_share=0.2, gaps_s=((10.0, 25.0),), delay_s=(0.1, 0.4))
    simulated = simulate_fixes(drive, errors, rng())
    stamps_ns = np.array([fix.stamp_ns for fix in simulated.fixes])
    assert not ((stamps_ns > 10e9) & (stamps_ns < 25e9)).any()
    delays = np.array([fix.arrival_ns for fix in simulated.fixes]) - stamps_ns
    assert 0.1e9 <= delays.min() < 0.15e9
    assert 0.35e9 < delays.max() <= 0.4e9
    poses = np.array([fix.fix.belief.pose.as_array() for fix in simulated.fixes])
    away = np.hypot(*(poses - drive.at(stamps_ns))[:, :2].T)
    assert 0.1 < simulated.outliers.mean() < 0.3
    assert away[simulated.outliers].min() > 0.3
    assert away[~simulated.outliers].max() < 0.3


def test_position_only_fixes_measure_no_heading(drive: Drive) -> None:
    fixes = simulate_fixes(drive, FixErrors(position_only=True), rng()).fixes
    assert all(fix.fix.belief.measured.tolist() == [True, True, False] for fix in fixes)


def test_fixes_through_a_misplaced_camera_err_by_its_place_and_its_clock(drive: Drive) -> None:
    exact = FixErrors(rate_hz=5.0, std_m=1e-9, std_rad=1e-9)
    moved = true_robot(EYED, Offsets(x_m=0.02, yaw_rad=0.01, time_offset_s=0.05))
    fixes = simulate_fixes(drive, exact, rng(), moved, EYED).fixes
    stamps_ns = np.array([fix.stamp_ns for fix in fixes])
    for fix, pose in zip(fixes, drive.at(stamps_ns + 50_000_000), strict=True):
        off = Pose2.from_array(pose).inverse() @ fix.fix.belief.pose
        # The camera's true place, then back by its nominal one: 0.02 ahead, less what the yaw turns the lever by.
        assert (off.x, off.y, off.phi) == pytest.approx((0.021, -0.002, 0.01), abs=2e-5)


def test_offsets_are_truth_less_nominal() -> None:
    robot = true_robot(EYED, Offsets(left_radius=0.01, baseline=-0.01, height_m=0.02, time_offset_s=-0.05))
    assert robot.wheels == WheelGeometry(0.0505, 0.05, 0.34 * 0.99)
    assert robot.camera is not None
    assert robot.camera.mount.height_m == pytest.approx(1.02)
    assert robot.time_offset_ns == -50_000_000
    drawn = UNCALIBRATED.drawn(rng())
    assert 0.0 < abs(drawn.yaw_rad) < UNCALIBRATED.yaw_rad
    assert drawn != UNCALIBRATED.drawn(rng(1))


@pytest.mark.parametrize("odometry", [WheelErrors(), TwistErrors()])
def test_the_runner_takes_a_session_from_memory(odometry: WheelErrors | TwistErrors) -> None:
    plan = SessionPlan(seconds=15.0, odometry=odometry)
    simulated = simulate_session(rng(4), plan)
    again = simulate_session(rng(4), plan)
    np.testing.assert_array_equal(simulated.session.odometry.values, again.session.odometry.values)
    result = run_session(simulated.session, RunConfig(), NullLog(), lambda *_: None)
    assert result.usable
    errors = errors_of(result.trajectories.filtered, simulated.drive.truth())
    assert np.median(errors.position_m) < 0.1


def test_encoders_need_wheels() -> None:
    bare = Robot(PLAIN_ROBOT.path, None, None, 0, None)
    with pytest.raises(ValueError, match="wheels"):
        simulate_session(rng(), SessionPlan(seconds=2.0), bare)
