import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from localization.odometry import (
    OdometryNoise,
    OdometryStep,
    WheelGeometry,
    advance,
    motion_jacobians,
    motion_noise,
    twist_step,
    wheel_step,
)
from maps.poses import Pose2

COVARIANCE = np.array([[4e-4, 1e-5], [1e-5, 9e-4]])
SECOND_NS = 1_000_000_000

poses = st.builds(Pose2, *[st.floats(-50.0, 50.0)] * 2, st.floats(-math.pi, math.pi))
turns = st.one_of(st.floats(-3.0, 3.0), st.floats(-2e-2, 2e-2), st.floats(-1e-8, 1e-8), st.just(0.0))
steps = st.builds(
    lambda forward, turn: OdometryStep(0, SECOND_NS, forward, turn, COVARIANCE, 1e-4),
    st.floats(-2.0, 2.0),
    turns,
)


def close(a: Pose2, b: Pose2) -> bool:
    return bool(np.allclose(a.minus(b), 0.0, atol=1e-9))


@given(poses, steps, st.integers(1, SECOND_NS - 1))
def test_parts_compose_back_to_the_step(pose, step, cut_ns):
    first, second = step.part(0, cut_ns), step.part(cut_ns, SECOND_NS)
    assert close(advance(advance(pose, first), second), advance(pose, step))
    assert np.allclose(first.covariance + second.covariance, step.covariance)
    assert first.sideways_m2 + second.sideways_m2 == pytest.approx(step.sideways_m2)


@given(poses, poses, steps)
def test_motion_does_not_depend_on_the_frame(frame, pose, step):
    assert close(advance(frame @ pose, step), frame @ advance(pose, step))


def test_the_whole_part_is_the_step_itself():
    step = OdometryStep(3, 10, 0.1, 0.2, COVARIANCE)
    assert step.part(3, 10) is step


@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-6, 9.9e-5, 1.01e-4, 0.5, math.pi])
def test_advance_is_the_arc(turn):
    end = advance(Pose2(0.0, 0.0, 0.0), OdometryStep(0, 1, 2.0, turn, COVARIANCE))
    if turn < 1e-5:
        expected = (2.0, turn, turn)  # to first order in the turn
    else:
        radius = 2.0 / turn
        expected = (radius * math.sin(turn), radius * (1.0 - math.cos(turn)), turn)
    assert end.as_array() == pytest.approx(expected, abs=1e-10)


@given(poses, steps)
def test_jacobians_agree_with_differences(pose, step):
    by_pose, by_motion = motion_jacobians(pose, step)
    h = 1e-5
    for i in range(3):
        shift = h * np.eye(3)[i]
        ahead = advance(Pose2.from_array(pose.as_array() + shift), step)
        behind = advance(Pose2.from_array(pose.as_array() - shift), step)
        assert ahead.minus(behind) / (2.0 * h) == pytest.approx(by_pose[:, i], abs=1e-5)
    for i, (forward, turn) in enumerate(h * np.eye(2)):

        def moved(sign, forward=forward, turn=turn):
            return OdometryStep(
                0, 1, step.forward_m + sign * forward, step.turn_rad + sign * turn, COVARIANCE
            )

        difference = advance(pose, moved(1.0)).minus(advance(pose, moved(-1.0)))
        assert difference / (2.0 * h) == pytest.approx(by_motion[:, i], abs=1e-5)


def test_sideways_slip_is_across_the_heading():
    step = OdometryStep(0, 1, 0.0, 0.0, np.zeros((2, 2)), 4.0)
    _, by_motion = motion_jacobians(Pose2(0.0, 0.0, 0.5 * math.pi), step)
    noise = motion_noise(Pose2(0.0, 0.0, 0.5 * math.pi), step, by_motion)
    assert noise == pytest.approx(np.diag([4.0, 0.0, 0.0]))


def test_wheel_step_on_unequal_wheels():
    geometry = WheelGeometry(0.1, 0.2, 0.5)
    step = wheel_step(0, SECOND_NS, 1.0, 1.0, geometry, OdometryNoise())
    assert (step.forward_m, step.turn_rad) == pytest.approx((0.15, 0.2))


def test_wheel_noise_is_that_of_each_wheel():
    noise = OdometryNoise(wheel_m2_per_m=0.01, floor_m2_per_s=0.0, floor_rad2_per_s=0.0)
    step = wheel_step(0, SECOND_NS, 0.0, -2.0, WheelGeometry(0.5, 0.5, 0.5), noise)
    # Only the right wheel rolled, 1 m: it moves the middle by half of its error, and turns by twice it.
    assert step.covariance == pytest.approx(0.01 * np.array([[0.25, 1.0], [1.0, 4.0]]))


@pytest.mark.parametrize(
    "still",
    [
        twist_step(0, SECOND_NS, 0.0, 0.0, OdometryNoise()),
        wheel_step(0, SECOND_NS, 0.0, 0.0, WheelGeometry(0.1, 0.1, 0.3), OdometryNoise()),
    ],
)
def test_standstill_keeps_a_floor_in_every_direction(still):
    _, by_motion = motion_jacobians(Pose2(0.0, 0.0, 1.0), still)
    assert np.linalg.eigvalsh(motion_noise(Pose2(0.0, 0.0, 1.0), still, by_motion)).min() > 0.0


def test_twist_noise_grows_with_the_way_whichever_its_direction():
    noise = OdometryNoise()
    ahead = twist_step(0, SECOND_NS, 0.5, 0.3, noise)
    back = twist_step(0, SECOND_NS, -0.5, -0.3, noise)
    far = twist_step(0, 2 * SECOND_NS, 0.5, 0.3, noise)
    assert (back.forward_m, back.turn_rad) == (-0.5, -0.3)
    assert np.array_equal(ahead.covariance, back.covariance)
    assert far.covariance == pytest.approx(2.0 * ahead.covariance)


def test_then_leaves_out_what_is_known_and_fills_what_is_missing():
    step = OdometryStep(0, 10, 1.0, 0.1, COVARIANCE)
    assert step.then(OdometryStep(2, 10, 5.0, 0.0, COVARIANCE)) == ()
    (rest,) = step.then(OdometryStep(0, 20, 4.0, 0.0, COVARIANCE))
    assert (rest.start_ns, rest.stamp_ns, rest.forward_m) == (10, 20, 2.0)
    late = OdometryStep(20, 30, 1.0, 0.1, COVARIANCE)
    hole, same = step.then(late)
    assert same is late
    assert (hole.start_ns, hole.stamp_ns, hole.forward_m) == (10, 20, 1.0)
    assert hole.covariance[0, 0] > 1.0  # the robot may have stopped
