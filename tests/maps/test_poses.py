"""Planar poses: the group's axioms, and angles near the wrap."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maps.poses import Pose2, frozen, wrap_angle

TINY = (0.0, 1e-300, 1e-16, 1e-12, 1e-8)
near_pi = st.builds(
    lambda sign, off, turns: sign * math.pi + off + turns * math.tau,
    st.sampled_from([-1.0, 1.0]),
    st.sampled_from([side * off for side in (-1.0, 1.0) for off in TINY]),
    st.integers(-3, 3),
)
angles = st.one_of(st.floats(-50.0, 50.0), near_pi, st.sampled_from([0.0, -0.0, math.pi, -math.pi]))
places = st.floats(-1e3, 1e3)
poses = st.builds(Pose2, places, places, angles)


def same(pose: Pose2, other: Pose2) -> bool:
    return bool(np.abs(pose.minus(other)).max() < 1e-9)


@given(angles)
def test_wrapped_angles_stay_in_the_half_open_circle_and_point_the_same_way(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert abs(math.remainder(wrapped - angle, math.tau)) < 1e-12


def test_both_ends_of_the_circle_become_plus_pi() -> None:
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(-math.pi) == math.pi
    assert wrap_angle(np.array([-math.pi, 0.0, math.pi])).tolist() == [math.pi, 0.0, math.pi]
    assert isinstance(wrap_angle(1.0), float)


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert same((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_identity_and_inverse(pose: Pose2) -> None:
    identity = Pose2(0.0, 0.0, 0.0)
    assert same(pose @ identity, pose)
    assert same(identity @ pose, pose)
    assert same(pose @ pose.inverse(), identity)
    assert same(pose.inverse() @ pose, identity)
    assert same(pose.inverse().inverse(), pose)


@given(poses, poses)
def test_composition_is_that_of_matrices(a: Pose2, b: Pose2) -> None:
    def matrix(pose: Pose2) -> np.ndarray:
        cos, sin = math.cos(pose.phi), math.sin(pose.phi)
        return np.array([[cos, -sin, pose.x], [sin, cos, pose.y], [0.0, 0.0, 1.0]])

    np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-9)


def test_a_step_forward_and_left_turns_with_the_robot() -> None:
    assert same(Pose2(1.0, 2.0, math.pi / 2) @ Pose2(3.0, 0.5, 0.25), Pose2(0.5, 5.0, math.pi / 2 + 0.25))


def test_differences_take_the_short_way_round() -> None:
    away = Pose2(0.0, 0.0, math.pi - 0.01).minus(Pose2(1.0, -2.0, -math.pi + 0.01))
    np.testing.assert_allclose(away, [-1.0, 2.0, -0.02], atol=1e-12)


@given(poses)
def test_arrays_and_back(pose: Pose2) -> None:
    assert Pose2.from_array(pose.as_array()) == pose


def test_values_are_frozen() -> None:
    pose, given_values = Pose2(1.0, 2.0, 3.0), np.ones(2)
    with pytest.raises(dataclasses.FrozenInstanceError):
        pose.x = 4.0  # type: ignore[misc]
    kept = frozen(given_values)
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 2.0
    given_values[0] = 5.0
    assert kept[0] == 1.0
