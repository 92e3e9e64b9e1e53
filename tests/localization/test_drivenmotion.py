"""Odometry as a function of the robot's parameters: closed forms, numeric slopes, the filter's own noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.drivenmotion import OdometryRecord, motions_between
from localization.ekf import Estimate, predict
from localization.odometry import OdometryNoise, WheelGeometry, wheel_step
from maps.outcomes import PoseBelief
from maps.poses import Pose2

NOISE = OdometryNoise()
WHEELS = np.array([0.05, 0.05, 0.34, 0.0])


def circling(seconds=8.0, forward=0.4, turn=0.3):
    """Wheels that drive a circle at 20 Hz."""
    stamps = np.arange(0.0, seconds, 0.05)
    rates = (forward + np.array([-1.0, 1.0]) * turn * 0.17) / 0.05
    return OdometryRecord(stamps, stamps[:, None] * rates, True)


def wandering(rng, by_wheels=True):
    stamps = np.cumsum(rng.uniform(0.01, 0.05, 400))
    rates = rng.normal(size=(400, 2)) * [3.0, 3.0] + [4.0, 5.0]
    if by_wheels:
        return OdometryRecord(stamps, np.cumsum(rates * 0.03, axis=0), True)
    return OdometryRecord(stamps, rates * 0.1, False)


def test_a_circle_has_its_closed_form():
    stamps = np.array([0.63, 2.21, 5.0])
    motions = motions_between(circling(), WHEELS, stamps, NOISE)
    turns = 0.3 * np.diff(stamps)
    radius = 0.4 / 0.3
    expected = np.column_stack([radius * np.sin(turns), radius * (1.0 - np.cos(turns)), turns])
    np.testing.assert_allclose(motions.poses, expected, atol=1e-12)


def test_the_time_offset_moves_the_stamps_on_odometrys_clock():
    record = wandering(np.random.default_rng(1))
    stamps = np.array([2.0, 3.1, 5.7])
    late = motions_between(record, np.append(WHEELS[:3], 0.04), stamps, NOISE)
    moved = motions_between(record, WHEELS, stamps + 0.04, NOISE)
    np.testing.assert_allclose(late.poses, moved.poses, atol=1e-12)


@pytest.mark.parametrize("by_wheels", [True, False])
def test_slopes_are_those_of_small_differences(by_wheels):
    record = wandering(np.random.default_rng(2), by_wheels)
    parameters = np.array([0.051, 0.049, 0.33, 0.003] if by_wheels else [1.1, 0.9, 0.01, 0.003])
    stamps = np.array([0.4, 1.03, 3.3, 6.1, 8.0])
    slopes = motions_between(record, parameters, stamps, NOISE).slopes
    for index in range(4):
        step = np.zeros(4)
        step[index] = 1e-7
        after = motions_between(record, parameters + step, stamps, NOISE).poses
        before = motions_between(record, parameters - step, stamps, NOISE).poses
        np.testing.assert_allclose(slopes[:, :, index], (after - before) / 2e-7, atol=2e-6)


def test_noise_is_that_of_the_filter_step_by_step():
    record = wandering(np.random.default_rng(3))
    geometry = WheelGeometry(0.05, 0.05, 0.34)
    rows = (40, 150)
    nothing = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.zeros((3, 3)))
    estimate = Estimate.of(nothing)
    for row in range(*rows):
        start, end = (round(record.stamps_s[at] * 1e9) for at in (row, row + 1))
        left, right = record.values[row + 1] - record.values[row]
        step = wheel_step(start, end, left, right, geometry, NOISE)
        # Random errors alone: those that last are the parameters' own.
        alone = type(step)(start, end, step.forward_m, step.turn_rad, step.covariance, step.sideways_m2)
        estimate = predict(estimate, alone)
    ours = motions_between(record, WHEELS, record.stamps_s[list(rows)], NOISE)
    np.testing.assert_allclose(ours.poses[0], estimate.belief.pose.as_array(), atol=1e-9)
    np.testing.assert_allclose(ours.covariances[0], estimate.belief.covariance, rtol=0.02, atol=1e-8)


def test_twists_hold_until_the_next_row_and_scale():
    record = OdometryRecord(np.array([0.0, 1.0, 2.0]), np.array([[0.5, 0.2], [0.1, 0.0], [9.0, 9.0]]), False)
    motions = motions_between(record, np.array([1.1, 0.9, 0.0, 0.0]), np.array([0.0, 1.0, 2.0]), NOISE)
    np.testing.assert_allclose(motions.poses[:, 2], [0.9 * 0.2, 0.0], atol=1e-12)
    assert math.hypot(*motions.poses[1, :2]) == pytest.approx(1.1 * 0.1)


def test_beyond_the_rows_the_robot_stands():
    motions = motions_between(circling(2.0), WHEELS, np.array([-1.0, -0.5, 5.0, 6.0]), NOISE)
    np.testing.assert_allclose(motions.poses[[0, 2]], 0.0, atol=1e-15)
    assert motions.poses[1, 2] == pytest.approx(0.3 * 1.95)
    np.testing.assert_allclose(motions.slopes[[0, 2]], 0.0, atol=1e-15)
