import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from localization.ekf import innovation, predict, update
from localization.odometry import OdometryStep
from maps.outcomes import PoseBelief
from maps.poses import Pose2

angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), angles)


def covariance_from(values):
    root = np.array(values).reshape(3, 3)
    return root @ root.T + 1e-6 * np.eye(3)


covariances = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9).map(covariance_from)
beliefs = st.builds(PoseBelief, st.just(0), poses, covariances)


@given(beliefs, beliefs)
def test_update_is_bayes_rule_for_gaussians(prior, fix):
    posterior = update(prior, fix)
    information = np.linalg.inv(prior.covariance) + np.linalg.inv(fix.covariance)
    expected = np.linalg.inv(information)
    shift = expected @ np.linalg.inv(fix.covariance) @ fix.pose.minus(prior.pose)
    assert posterior.covariance == pytest.approx(expected, rel=1e-4, abs=1e-8)
    assert posterior.pose.minus(prior.pose)[:2] == pytest.approx(shift[:2], rel=1e-4, abs=1e-5)
    assert math.cos(posterior.pose.phi - prior.pose.phi - shift[2]) == pytest.approx(1.0, abs=1e-8)


@given(beliefs, beliefs, st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_covariances_stay_symmetric_and_positive(prior, fix, forward, turn):
    step = OdometryStep(0, 1, forward, turn, 0.01 * np.eye(2), 0.01)
    for belief in (predict(prior, step), update(prior, fix)):
        assert np.array_equal(belief.covariance, belief.covariance.T)
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0


def test_arguments_and_repeated_calls_do_not_touch_each_other():
    prior = PoseBelief(0, Pose2(1.0, 2.0, 3.0), 0.1 * np.eye(3))
    step = OdometryStep(0, 1, 1.0, 0.5, 0.01 * np.eye(2))
    first = predict(prior, step)
    update(first, prior)
    second = predict(prior, step)
    assert np.array_equal(first.covariance, second.covariance)
    assert first.pose == second.pose


def test_heading_residual_is_wrapped():
    prior = PoseBelief(0, Pose2(0.0, 0.0, 3.1), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(0.0, 0.0, -3.1), np.diag([1.0, 1.0, 0.04]))
    assert innovation(prior, fix).residual[2] == pytest.approx(2.0 * math.pi - 6.2)
    assert abs(update(prior, fix).pose.phi) == pytest.approx(math.pi)


def test_position_only_fix_measures_position_only():
    prior = PoseBelief(0, Pose2(0.0, 0.0, 0.5), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(1.0, -1.0, 2.0), np.diag([1.0, 1.0, math.inf]))
    news = innovation(prior, fix)
    assert news.dof == 2
    assert news.nis == pytest.approx(1.0)
    posterior = update(prior, fix)
    assert posterior.pose.as_array() == pytest.approx([0.5, -0.5, 0.5])
    assert posterior.covariance == pytest.approx(np.diag([0.5, 0.5, 0.04]))


def test_heading_only_fix_measures_heading_only():
    prior = PoseBelief(0, Pose2(3.0, 4.0, 3.1), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(0.0, 0.0, -3.1), np.diag([math.inf, math.inf, 0.04]))
    assert innovation(prior, fix).dof == 1
    posterior = update(prior, fix)
    assert (posterior.pose.x, posterior.pose.y) == (3.0, 4.0)
    assert abs(posterior.pose.phi) == pytest.approx(math.pi)


@pytest.mark.parametrize(("stds", "dof"), [((1.0, 1.0, 1.0), 3), ((1.0, 1.0, math.inf), 2)])
def test_gate_is_the_chi_square_quantile(stds, dof):
    prior = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag([3.0, 3.0, 3.0]))
    edge = 2.0 * math.sqrt(chi2.ppf(0.999, dof))  # S is 4 in every component
    for factor, inside in ((0.999, True), (1.001, False)):
        fix = PoseBelief(0, Pose2(factor * edge, 0.0, 0.0), np.diag(np.square(stds)))
        assert innovation(prior, fix).inside(0.999) is inside


def test_filter_is_honest_over_simulated_drives(simulate):
    runs = 40
    total = 0.0
    for seed in range(runs):
        drive = simulate(seed, steps=60)
        belief, fixes = drive.initial, {fix.stamp_ns: fix for fix in drive.fixes}
        for step in drive.steps:
            for stamp_ns in sorted({step.start_ns + 50_000_000, step.stamp_ns}):
                belief = predict(belief, step.part(belief.stamp_ns, stamp_ns))
                if stamp_ns in fixes:
                    belief = update(belief, fixes[stamp_ns])
        total += drive.nees(belief)
    assert chi2.ppf(0.005, 3 * runs) < total < chi2.ppf(0.995, 3 * runs)
