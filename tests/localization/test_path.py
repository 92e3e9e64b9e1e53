import math

import numpy as np
import pytest

from localization.ekf import Estimate, predict
from localization.odometry import OdometryStep
from localization.path import ReckonedPath
from maps.outcomes import PoseBelief
from maps.poses import Pose2

STEP_NS = 100_000_000
START = Estimate.of(PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.zeros((3, 3))))


def step_to(end: int) -> OdometryStep:
    return OdometryStep(
        (end - 1) * STEP_NS, end * STEP_NS, 0.1, 0.1 * math.cos(end), np.array([[1e-4, 1e-5], [1e-5, 4e-4]])
    )


def path_to(*ends: int) -> ReckonedPath:
    path = ReckonedPath(0)
    for end in ends:
        path.append(step_to(end))
    return path


def same(a: PoseBelief | None, b: Estimate) -> bool:
    return (
        a is not None
        and (a.stamp_ns, a.pose) == (b.stamp_ns, b.pose)
        and bool((a.covariance == b.covariance).all())
    )


def test_at_the_steps_between_them_and_beyond() -> None:
    path, one = path_to(1, 2), predict(START, step_to(1))
    two = predict(one, step_to(2))
    assert same(path.belief_at(0), START)
    assert same(path.belief_at(STEP_NS), one)
    assert same(path.belief_at(STEP_NS // 2), predict(START, step_to(1).part(0, STEP_NS // 2)))
    assert same(path.belief_at(3 * STEP_NS // 2), predict(one, step_to(2).part(STEP_NS, 3 * STEP_NS // 2)))
    assert same(path.belief_at(2 * STEP_NS), two)
    ahead = path.belief_at(5 * STEP_NS // 2)
    assert ahead is not None
    assert ahead.pose.x == pytest.approx(two.mean[0], abs=0.06)
    assert np.linalg.eigvalsh(ahead.covariance - two.covariance)[-1] > 1e-3
    assert path.belief_at(-1) is None


def test_nothing_counts_twice_and_holes_are_guessed() -> None:
    path = path_to(1, 1, 2, 1)
    assert same(path.belief_at(2 * STEP_NS), predict(predict(START, step_to(1)), step_to(2)))
    path.append(step_to(5))
    assert [(step.start_ns, step.stamp_ns) for step in path.steps] == [
        (end - gone, end)
        for gone, end in (
            (STEP_NS, STEP_NS),
            (STEP_NS, 2 * STEP_NS),
            (2 * STEP_NS, 4 * STEP_NS),
            (STEP_NS, 5 * STEP_NS),
        )
    ]
    end = path.belief_at(5 * STEP_NS)
    assert end is not None
    assert end.covariance[0, 0] > 0.03  # 0.2 m were guessed


def test_before_any_odometry_the_robot_is_taken_to_stand() -> None:
    ahead = ReckonedPath(0).belief_at(STEP_NS)
    assert ahead is not None
    assert ahead.pose == Pose2(0.0, 0.0, 0.0)
