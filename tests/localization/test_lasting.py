"""Systematic errors of odometry, and slips, in the smoother."""

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.ekf import Estimate
from localization.factors import graph_of, gtsam_pose, motion_covariances, pose_factors, whitening
from localization.lasting import JointConfig, joint_optimum
from localization.odometry import OdometryNoise, WheelGeometry, advance, wheel_step
from localization.smoother import SmootherConfig, huber_optimum, smooth, start_values
from localization.spans import spans_of
from maps.outcomes import PoseBelief
from maps.poses import Pose2

STEP_NS = 100_000_000
TOLD = WheelGeometry(0.05, 0.05, 0.3)
#: Its left wheel is 1 % larger than told: two standard deviations.
TRUE = WheelGeometry(0.0505, 0.05, 0.3)
START = PoseBelief(0, Pose2(0.0, 0.0, 0.0), 1e-6 * np.eye(3))


def driven(steps=400, gap=(20.0, 32.0), slip_at=None):
    """An exact drive of the true wheels, odometry of the told ones, a fix a second but in the gap."""
    poses, odometry, fixes = [START.pose], [], []
    for i in range(steps):
        turn = 0.3 * math.sin(i / 40.0)
        wheels = (i * STEP_NS, (i + 1) * STEP_NS, 1.0 - turn, 1.0 + turn)
        true = wheel_step(*wheels, TRUE, OdometryNoise())
        if i == slip_at:
            true = replace(true, turn_rad=true.turn_rad + 0.15)
        odometry.append(wheel_step(*wheels, TOLD, OdometryNoise()))
        poses.append(advance(poses[-1], true))
        stamp_ns = odometry[-1].stamp_ns
        if i % 10 == 9 and not gap[0] < stamp_ns * 1e-9 < gap[1]:
            fixes.append(PoseBelief(stamp_ns, poses[-1], np.diag([1e-4, 1e-4, 1e-5])))
    return odometry, fixes, poses


def far_m(beliefs, poses):
    return [math.hypot(*b.pose.minus(pose)[:2]) for b, pose in zip(beliefs, poses, strict=True)]


def test_a_wheel_that_is_larger_than_told_is_found_and_bridges_the_gap():
    odometry, fixes, poses = driven()
    knowing = far_m(smooth(START, odometry, fixes).beliefs, poses)
    assert max(knowing) < 0.02
    blind = [replace(step, systematic=np.zeros((3, 4))) for step in odometry]
    assert max(knowing[200:320]) < 0.3 * max(far_m(smooth(START, blind, fixes).beliefs, poses)[200:320])


def test_the_parameter_comes_out_in_its_standard_deviations():
    odometry, fixes, _ = driven()
    spans = spans_of(0, odometry, 0.25, (fix.stamp_ns for fix in fixes))
    keys = {span.end.stamp_ns: key for key, span in enumerate(spans, start=1)}
    looks = [(keys[fix.stamp_ns], fix) for fix in fixes]
    values = huber_optimum(START, spans, looks, start_values(spans, (START,)), SmootherConfig())
    priors = [*pose_factors(0, START), *(factor for key, fix in looks for factor in pose_factors(key, fix))]
    joint = joint_optimum(graph_of(priors), spans, [key for key, _ in looks], values, JointConfig())
    left, right, baseline, crab = joint.parameters[100]
    assert left == pytest.approx(2.0, abs=0.3)
    assert np.abs([right, baseline, crab]).max() < 0.4


def test_a_gap_is_known_as_well_as_the_parameters_are():
    """Errors that last grow with the way, random ones with its root: both are in the covariance of a gap."""
    odometry, fixes, _ = driven()
    known = smooth(START, odometry, fixes).beliefs
    few = smooth(START, odometry, [fix for fix in fixes if fix.stamp_ns > 30e9]).beliefs
    assert known[260].position_std_m > 2.0 * known[150].position_std_m
    assert few[150].position_std_m > 2.0 * known[260].position_std_m


def test_odometry_lets_go_where_a_wheel_slipped():
    odometry, fixes, poses = driven(slip_at=155)
    tails = far_m(smooth(START, odometry, fixes).beliefs, poses)
    gaussian = SmootherConfig(joint=JointConfig(freedom=1e9))
    without = far_m(smooth(START, odometry, fixes, gaussian).beliefs, poses)
    assert np.mean(tails) < 0.8 * np.mean(without)
    assert max(tails[:140]) < 0.02


def test_long_without_any_fix_and_standing_still_half_of_it():
    odometry, _, _ = driven(600)
    still = [
        wheel_step(step.start_ns, step.stamp_ns, 0.0, 0.0, TOLD, OdometryNoise()) for step in odometry[300:]
    ]
    last = smooth(START, [*odometry[:300], *still], []).beliefs[-1]
    assert last.position_std_m > 0.1
    anywhere = PoseBelief(0, START.pose, np.diag([1e4, 1e4, 10.0]))
    end = PoseBelief(odometry[-1].stamp_ns, Pose2(5.0, 5.0, 1.0), 1e-4 * np.eye(3))
    beliefs = smooth(anywhere, odometry, [end]).beliefs
    assert beliefs[-1].pose.minus(end.pose) == pytest.approx(np.zeros(3), abs=1e-3)
    assert 0.1 < beliefs[0].position_std_m < 10.0


def test_whitening_is_gtsams():
    spans = spans_of(0, driven(10)[0], 0.5)
    (covariance,) = motion_covariances(spans[:1], 0.1, known=True)
    (root,) = whitening(np.array([0.7]), covariance[None])
    turned = gtsam_pose(Pose2(0.0, 0.0, 0.7)).rotation().matrix()
    body = covariance.copy()
    body[:2, :2] = turned.T @ covariance[:2, :2] @ turned
    body[:2, 2] = body[2, :2] = turned.T @ covariance[:2, 2]
    assert np.linalg.inv(root.T @ root) == pytest.approx(body, rel=1e-6, abs=1e-12)
    assert np.allclose(root, np.triu(root))


def test_spans_split_the_motion_into_lasting_and_random():
    (span,) = spans_of(0, driven(5)[0], 10.0)
    (random,), (whole,) = (motion_covariances([span], 0.0, known) for known in (True, False))
    assert random + span.lasting @ span.lasting.T == pytest.approx(whole)
    assert whole == pytest.approx(span.end.covariance, abs=2e-8)
    assert np.linalg.eigvalsh(random).min() > 0.0
    moved = span.moved_by(np.array([1.0, 0.0, 0.0, 0.0]))
    assert moved.minus(span.end.pose) == pytest.approx(span.lasting[:, 0])
    assert span.until(span.end.stamp_ns).minus(span.end.pose) == pytest.approx(np.zeros(3))
    halfway = span.until(STEP_NS // 2)
    assert halfway.minus(span.within[0].pose) == pytest.approx(-0.5 * span.within[0].mean[:3])


def test_nodes_lie_where_asked_and_often_enough():
    spans = spans_of(0, driven(20)[0], 0.25, (130_000_000, 700_000_000))
    ends = [span.end.stamp_ns / 1e9 for span in spans]
    assert ends == pytest.approx([0.13, 0.4, 0.7, 1.0, 1.3, 1.6, 1.9, 2.0])
    assert [span.start_ns for span in spans[1:]] == [span.end.stamp_ns for span in spans[:-1]]
    assert isinstance(spans[0].end, Estimate)
