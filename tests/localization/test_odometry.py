import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localization.odometry import (
    OdometryNoise,
    OdometryStep,
    WheelGeometry,
    advance,
    standing_step,
    twist_step,
    wheel_step,
)
from maps.poses import Pose2

COVARIANCE = np.array([[4e-4, 1e-5], [1e-5, 9e-4]])
SECOND_NS = 1_000_000_000

poses = st.builds(Pose2, *[st.floats(-50.0, 50.0)] * 2, st.floats(-math.pi, math.pi))
turns = st.one_of(st.floats(-3.0, 3.0), st.floats(-2e-2, 2e-2), st.floats(-1e-8, 1e-8), st.just(0.0))
SYSTEMATIC = 1e-2 * np.arange(12.0).reshape(3, 4)
NOISE = OdometryNoise()
steps = st.builds(
    lambda forward, turn: OdometryStep(0, SECOND_NS, forward, turn, COVARIANCE, 1e-4, SYSTEMATIC, 0.1, 10.0),
    st.floats(-2.0, 2.0),
    turns,
)


def close(a: Pose2, b: Pose2) -> bool:
    return bool(np.allclose(a.minus(b), 0.0, atol=1e-9))


@settings(deadline=None)  # the first call may compile
@given(poses, steps, st.integers(1, SECOND_NS - 1))
def test_parts_compose_back_to_the_step(pose, step, cut_ns):
    first, second = step.part(0, cut_ns), step.part(cut_ns, SECOND_NS)
    assert close(advance(advance(pose, first), second), advance(pose, step))
    assert np.allclose(first.covariance + second.covariance, step.covariance)
    assert first.sideways_m2 + second.sideways_m2 == pytest.approx(step.sideways_m2)
    assert np.allclose(first.systematic + second.systematic, step.systematic)
    assert first.forgetting + second.forgetting == pytest.approx(step.forgetting)
    assert first.slip == second.slip == step.slip


@settings(deadline=None)
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


def test_wheel_step_on_unequal_wheels():
    geometry = WheelGeometry(0.1, 0.2, 0.5)
    step = wheel_step(0, SECOND_NS, 1.0, 1.0, geometry, OdometryNoise())
    assert (step.forward_m, step.turn_rad) == pytest.approx((0.15, 0.2))


def test_wheel_noise_is_that_of_each_wheel():
    noise = OdometryNoise(wheel_m2_per_m=0.01, floor_m2_per_s=0.0, floor_rad2_per_s=0.0, swerve_radps2=0.0)
    step = wheel_step(0, SECOND_NS, 0.0, -2.0, WheelGeometry(0.5, 0.5, 0.5), noise)
    # Only the right wheel rolled, 1 m: it moves the middle by half of its error, and turns by twice it.
    assert step.covariance == pytest.approx(0.01 * np.array([[0.25, 1.0], [1.0, 4.0]]))


@pytest.mark.parametrize(
    ("seconds", "aside_m"), [(0.02, 2.0 * 0.02**3 / 12.0), (1.0, 2.0 / 12.0), (10.0, 2.5)]
)
def test_nobody_sees_the_way_between_two_rows(seconds, aside_m):
    """A turn that came early or late: nothing at any usual rate, a quarter of the way where rows are lost."""
    noise = OdometryNoise(wheel_m2_per_m=0.0, floor_m2_per_s=0.0, floor_rad2_per_s=0.0)
    turned = 10.0 * seconds
    step = wheel_step(0, round(seconds * SECOND_NS), turned, turned, WheelGeometry(0.1, 0.1, 0.5), noise)
    assert math.sqrt(step.sideways_m2) == pytest.approx(aside_m, rel=0.01)
    assert math.sqrt(step.covariance[0, 0]) == pytest.approx(0.3 * aside_m, rel=1e-6)
    assert step.covariance[1, 1] == 0.0


def test_the_end_of_a_turn_that_quickens_is_as_far_aside_as_is_said():
    noise, seconds = OdometryNoise(wheel_m2_per_m=0.0, floor_m2_per_s=0.0), 1.0
    pose, parts = Pose2(0.0, 0.0, 0.0), 1000
    for part in range(parts):
        rate = noise.swerve_radps2 * ((part + 0.5) / parts - 0.5) * seconds
        arc = OdometryStep(part, part + 1, 1.0 / parts, rate * seconds / parts, np.zeros((2, 2)))
        pose = advance(pose, arc)
    step = wheel_step(0, SECOND_NS, 10.0, 10.0, WheelGeometry(0.1, 0.1, 0.5), noise)
    assert pose.phi == pytest.approx(0.0, abs=1e-9)
    assert abs(pose.y) == pytest.approx(math.sqrt(step.sideways_m2), rel=0.02)


@pytest.mark.parametrize(
    "still",
    [
        twist_step(0, SECOND_NS, 0.0, 0.0, OdometryNoise()),
        wheel_step(0, SECOND_NS, 0.0, 0.0, WheelGeometry(0.1, 0.1, 0.3), OdometryNoise()),
        standing_step(0, SECOND_NS, OdometryNoise()),
    ],
)
def test_standstill_keeps_a_floor_in_every_direction(still):
    assert np.linalg.eigvalsh(still.random).min() > 0.0


GEOMETRY = WheelGeometry(0.06, 0.05, 0.3, 0.001, 0.002, 0.003)


@pytest.mark.parametrize("column", range(3))
def test_systematic_errors_are_derivatives_by_the_geometry(column):
    """One standard deviation more of a radius or of the baseline, against the difference that it makes."""
    names = ("left_radius_m", "right_radius_m", "baseline_m")
    std = (0.001, 0.002, 0.003)[column]
    nominal = getattr(GEOMETRY, names[column])
    ahead, behind = (
        wheel_step(0, SECOND_NS, 2.0, 5.0, replace(GEOMETRY, **{names[column]: nominal + h * std}), NOISE)
        for h in (1e-4, -1e-4)
    )
    slopes = [(ahead.forward_m - behind.forward_m) / 2e-4, (ahead.turn_rad - behind.turn_rad) / 2e-4, 0.0]
    step = wheel_step(0, SECOND_NS, 2.0, 5.0, GEOMETRY, NOISE)
    assert step.systematic[:, column] == pytest.approx(slopes, abs=1e-9)


def test_what_the_geometry_does_not_say_is_a_share():
    noise = OdometryNoise(radius_share=0.01, baseline_share=0.02, crab_rad=0.1)
    step = wheel_step(0, SECOND_NS, -1.0, 1.0, WheelGeometry(0.5, 0.5, 0.5), noise)
    assert step.systematic[1] == pytest.approx([0.01, 0.01, -0.04, 0.0])
    ahead = wheel_step(0, SECOND_NS, 1.0, 1.0, WheelGeometry(0.5, 0.5, 0.5), noise)
    assert ahead.systematic[:, 3] == pytest.approx([0.0, 0.0, 0.05])


def test_a_twist_has_scales_a_bias_and_a_crab():
    noise = OdometryNoise(
        twist_forward_share=0.1, twist_turn_share=0.2, twist_bias_radps=0.01, crab_rad=0.03, memory_s=50.0
    )
    step = twist_step(0, 2 * SECOND_NS, 0.5, -0.3, noise)
    expected = [[0.1, 0.0, 0.0, 0.0], [0.0, -0.12, 0.02, 0.0], [0.0, 0.0, 0.0, 0.03]]
    assert step.systematic == pytest.approx(np.array(expected))
    assert step.forgetting == pytest.approx(0.04)
    assert not standing_step(0, SECOND_NS, noise).systematic.any()


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
