"""Over seeded sessions the filter's errors are what its covariance says."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from honesty import honesty_of

from localization.odometry import OdometryNoise
from runs.simulation.offsets import Offsets
from runs.simulation.paths import DriveKind
from runs.simulation.synthetic import SessionPlan
from runs.simulation.wheels import TwistErrors, WheelErrors

KINDS = list(DriveKind)
#: What a filter is told that knows how the default session is simulated: offsets even within 0.5 %, no crab.
WHEEL_NOISE = OdometryNoise(
    wheel_m2_per_m=WheelErrors().noise_m2_per_m,
    radius_share=0.005 / math.sqrt(3.0),
    baseline_share=0.005 / math.sqrt(3.0),
    crab_rad=0.0,
    memory_s=1e6,
)
#: A robot that reports good twists, and what its filter is told.
TWISTS = TwistErrors(forward_scale=0.01, turn_scale=-0.01, bias_radps=0.002)
TWIST_NOISE = OdometryNoise(
    twist_forward_m2_per_m=TWISTS.forward_m2_per_m,
    twist_turn_rad2_per_rad=TWISTS.turn_rad2_per_rad,
    twist_turn_rad2_per_m=TWISTS.turn_rad2_per_m,
    twist_forward_share=0.01,
    twist_turn_share=0.01,
    crab_rad=0.0,
    memory_s=1e6,
)


@dataclass(frozen=True)
class Exactly(Offsets):
    """Offsets that are not drawn."""

    def drawn(self, rng: np.random.Generator) -> Offsets:  # noqa: ARG002
        return self


@pytest.mark.parametrize("kind", KINDS)
def test_eight_sessions(kind):
    """The same as the study below, too short to tell more than gross mistakes."""
    honesty = honesty_of(SessionPlan(kind=kind, seconds=30.0), OdometryNoise(), range(8))
    assert 0.6 < honesty.anees < 1.6
    assert honesty.band[0] < honesty.anis < honesty.band[1]


def test_a_filter_that_is_told_too_little_noise_is_found_out():
    proud = OdometryNoise(
        wheel_m2_per_m=1e-7, radius_share=1e-5, baseline_share=1e-5, crab_rad=1e-5, wheel_slip=0.0
    )
    honesty = honesty_of(SessionPlan(seconds=30.0), proud, range(8))
    assert honesty.anees > 1.6
    assert honesty.anis > honesty.band[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_hundred_sessions(kind):
    honesty = honesty_of(SessionPlan(kind=kind), WHEEL_NOISE, range(100))
    assert 0.8 <= honesty.anees <= 1.25
    assert honesty.band[0] <= honesty.anis <= honesty.band[1]
    assert honesty.refused <= 0.003


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_hundred_sessions_of_a_filter_that_is_told_nothing(kind):
    """The defaults, on wheels with twice the random noise that they expect: NIS may leave its narrow band."""
    honesty = honesty_of(SessionPlan(kind=kind), OdometryNoise(), range(100))
    assert 0.8 <= honesty.anees <= 1.25
    assert 0.9 <= honesty.anis <= 1.1


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_hundred_sessions_of_twists(kind):
    honesty = honesty_of(SessionPlan(kind=kind, odometry=TWISTS), TWIST_NOISE, range(100))
    assert 0.8 <= honesty.anees <= 1.25
    assert honesty.band[0] <= honesty.anis <= honesty.band[1]


@pytest.mark.slow
@pytest.mark.parametrize("signs", [(1, -1, 1), (-1, 1, -1), (1, 1, -1)])
def test_hundred_sessions_on_wheels_that_are_off_by_a_percent(signs):
    """Twice the standard deviation that the filter expects of a radius."""
    offsets = Exactly(*(0.01 * sign for sign in signs))
    honesty = honesty_of(SessionPlan(offsets=offsets), OdometryNoise(), range(100))
    assert honesty.anees <= 1.6
    assert math.isfinite(honesty.anis)
    assert honesty.refused <= 0.01
