import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localization.motion import by_motion, displacement

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-2.0, 2.0)
turns = st.one_of(st.floats(-3.0, 3.0), st.floats(-2e-2, 2e-2), st.floats(-1e-8, 1e-8), st.just(0.0))


def end(phi, forward, turn, sideways):
    return np.array([*displacement(phi, forward, turn, sideways), phi + turn])


@settings(deadline=None)  # the first call may compile
@given(angles, lengths, turns, lengths)
def test_derivatives_agree_with_differences(phi, forward, turn, sideways):
    motion, h = np.array([forward, turn, sideways]), 1e-5
    slopes = by_motion(phi, *motion)
    for i in range(3):
        shift = h * np.eye(3)[i]
        difference = end(phi, *(motion + shift)) - end(phi, *(motion - shift))
        assert difference / (2.0 * h) == pytest.approx(slopes[:, i], abs=1e-5)
    difference = end(phi + h, *motion) - end(phi - h, *motion)
    x, y = displacement(phi, *motion)
    assert difference / (2.0 * h) == pytest.approx([-y, x, 1.0], abs=1e-5)


def test_sideways_is_to_the_left():
    assert displacement(0.0, 0.0, 0.0, 2.0) == pytest.approx((0.0, 2.0))
    assert displacement(0.5 * math.pi, 1.0, 0.0, 2.0) == pytest.approx((-2.0, 1.0))


@pytest.mark.parametrize("turn", [1e-6, 9.9e-5, 1.01e-4, 0.5, math.pi])
def test_sideways_runs_along_a_circle_too(turn):
    radius = 2.0 / turn
    expected = (-radius * (1.0 - math.cos(turn)), radius * math.sin(turn))
    assert displacement(0.0, 0.0, turn, 2.0) == pytest.approx(expected, abs=1e-9)
