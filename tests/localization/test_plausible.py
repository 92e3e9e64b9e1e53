"""Odometry that no wheel can have rolled is not believed; hard driving, gaps and stamps that jitter are."""

from __future__ import annotations

import numpy as np
import pytest

from localization.localizer import Localizer
from localization.odometry import OdometryNoise, OdometryStep, WheelGeometry, twist_step, wheel_step
from localization.plausible import Plausibility
from maps.outcomes import PoseBelief
from maps.poses import Pose2

WHEELS, NOISE = WheelGeometry(0.05, 0.05, 0.34), OdometryNoise()
PERIOD_NS = 20_000_000
#: A wheel's roll within a period at 0.5 m/s.
ROLL_RAD = 0.2


def steps(rolls: list[tuple[float, float]], period_ns: int = PERIOD_NS) -> list[OdometryStep]:
    """Wheel steps one after the other, in radians left and right."""
    return [
        wheel_step(row * period_ns, (row + 1) * period_ns, *roll, WHEELS, NOISE)
        for row, roll in enumerate(rolls)
    ]


@pytest.mark.parametrize("jump", [(10.0, 0.0), (0.0, -10.0), (2000.0, 2000.0), (-50.0, 50.0)])
def test_a_counter_that_jumps_is_replaced_by_the_motion_before(jump: tuple[float, float]) -> None:
    rolls = [(ROLL_RAD, ROLL_RAD)] * 20
    rolls[10] = (ROLL_RAD + jump[0], ROLL_RAD + jump[1])
    grip = Plausibility()
    believed = [grip.checked(step) for step in steps(rolls)]
    assert grip.refused == 1
    assert believed[10].forward_m == pytest.approx(0.01)
    assert believed[10].turn_rad == pytest.approx(0.0)
    # Nobody measured it: it may as well have stood still.
    assert believed[10].covariance[0, 0] > 0.01**2
    assert [one.forward_m for one in believed[11:]] == pytest.approx([0.01] * 9)


def test_a_counter_that_jumps_at_once_is_replaced_by_standing_still() -> None:
    grip = Plausibility()
    first, second = (grip.checked(step) for step in steps([(30.0, 0.0), (ROLL_RAD, ROLL_RAD)]))
    assert (first.forward_m, first.turn_rad) == (0.0, 0.0)
    assert second.forward_m == pytest.approx(0.01)


def test_a_counter_that_begins_anew_after_a_gap_is_not_believed() -> None:
    grip = Plausibility()
    for step in steps([(ROLL_RAD, ROLL_RAD)] * 5):
        grip.checked(step)
    again = grip.checked(wheel_step(5 * PERIOD_NS, 5 * PERIOD_NS + 10**10, -4000.0, -4000.0, WHEELS, NOISE))
    assert grip.refused == 1
    # Ten seconds at half a metre a second, or none, or twice as much.
    assert again.forward_m == pytest.approx(5.0)
    assert again.covariance[0, 0] > 25.0


def test_hard_driving_is_believed() -> None:
    """From standing to 2 m/s within 0.3 s, a spin on the spot, an emergency stop."""
    faster = [(0.8 * step / 15, 0.8 * step / 15) for step in range(16)]
    spin = [(-0.4, 0.4)] * 20
    grip = Plausibility()
    for step in steps([*faster, (0.8, 0.8), (0.0, 0.0), *spin, (0.0, 0.0)]):
        assert grip.checked(step) is step


@pytest.mark.parametrize("rate_hz", [1, 5, 10, 50, 200])
def test_a_drive_is_believed_at_any_rate_with_stamps_that_jitter(rate_hz: int) -> None:
    rng, period_ns = np.random.default_rng(3), 10**9 // rate_hz
    true_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    stamps_ns = ((true_s + rng.uniform(-0.2, 0.2, len(true_s)) / rate_hz) * 1e9).astype(np.int64) + period_ns
    left_rad = np.interp(true_s, [0, 2, 6, 7, 20], [0, 30, 80, 85, 200])
    right_rad = np.interp(true_s, [0, 2, 6, 7, 20], [0, 30, 120, 115, 200])
    grip = Plausibility()
    for row in range(1, len(true_s)):
        roll = left_rad[row] - left_rad[row - 1], right_rad[row] - right_rad[row - 1]
        grip.checked(wheel_step(int(stamps_ns[row - 1]), int(stamps_ns[row]), *roll, WHEELS, NOISE))
    assert grip.refused == 0


def test_a_twist_that_reads_nonsense_is_not_believed_and_a_new_speed_soon_is() -> None:
    period_ns = 10**8
    twists = [(0.5, 0.0)] * 5 + [(10.0, 20.0)] + [(0.5, 0.0)] * 5 + [(3.5, 0.0)] * 10
    grip = Plausibility()
    believed = [
        grip.checked(twist_step(row * period_ns, (row + 1) * period_ns, *twist, NOISE))
        for row, twist in enumerate(twists)
    ]
    assert believed[5].forward_m == pytest.approx(0.05)
    assert [one.forward_m for one in believed[-6:]] == pytest.approx([0.35] * 6)


def test_the_localizer_returns_what_it_believed() -> None:
    localizer = Localizer(PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag([1e-4, 1e-4, 1e-4])))
    rolls = [(ROLL_RAD, ROLL_RAD)] * 10
    rolls[5] = (10.0, ROLL_RAD)
    believed = [localizer.predict(step) for step in steps(rolls)]
    assert localizer.implausible == 1
    assert sum(step.forward_m for step in believed) == pytest.approx(0.1)
    assert localizer.belief is not None
    assert localizer.belief.pose.x == pytest.approx(0.1)
    assert localizer.odom_from_robot.x == pytest.approx(0.1)
