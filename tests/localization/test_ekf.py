import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from localization.ekf import Estimate, innovation, predict, update
from localization.odometry import PARAMETERS, OdometryNoise, OdometryStep, WheelGeometry, advance, wheel_step
from maps.outcomes import PoseBelief
from maps.poses import Pose2

SECOND_NS = 1_000_000_000

angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), angles)


def covariance_from(values):
    root = np.array(values).reshape(3, 3)
    return root @ root.T + 1e-6 * np.eye(3)


covariances = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9).map(covariance_from)
beliefs = st.builds(PoseBelief, st.just(0), poses, covariances)


@settings(deadline=None)  # the first call may compile
@given(beliefs, beliefs)
def test_update_is_bayes_rule_for_gaussians(prior, fix):
    assume(abs(fix.pose.minus(prior.pose)[2]) < 3.14)  # half a turn has no sign
    posterior = update(Estimate.of(prior), fix).belief
    information = np.linalg.inv(prior.covariance) + np.linalg.inv(fix.covariance)
    expected = np.linalg.inv(information)
    shift = expected @ np.linalg.inv(fix.covariance) @ fix.pose.minus(prior.pose)
    assert posterior.covariance == pytest.approx(expected, rel=1e-4, abs=1e-8)
    assert posterior.pose.minus(prior.pose)[:2] == pytest.approx(shift[:2], rel=1e-4, abs=1e-5)
    assert math.cos(posterior.pose.phi - prior.pose.phi - shift[2]) == pytest.approx(1.0, abs=1e-8)


@settings(deadline=None)  # the first call may compile
@given(beliefs, beliefs, st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_covariances_stay_symmetric_and_positive(prior, fix, forward, turn):
    step = OdometryStep(0, 1, forward, turn, 0.01 * np.eye(2), 0.01)
    start = Estimate.of(prior)
    for belief in (predict(start, step).belief, update(start, fix).belief):
        assert np.array_equal(belief.covariance, belief.covariance.T)
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0


def test_arguments_and_repeated_calls_do_not_touch_each_other():
    prior = Estimate.of(PoseBelief(0, Pose2(1.0, 2.0, 3.0), 0.1 * np.eye(3)))
    step = OdometryStep(0, 1, 1.0, 0.5, 0.01 * np.eye(2), slip=2.0)
    first = predict(prior, step)
    update(first, prior.belief)
    second = predict(prior, step)
    for a, b in ((first.joint, second.joint), (first.mean, second.mean), (first.slip, second.slip)):
        assert np.array_equal(a, b)


def test_heading_residual_is_wrapped():
    prior = PoseBelief(0, Pose2(0.0, 0.0, 3.1), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(0.0, 0.0, -3.1), np.diag([1.0, 1.0, 0.04]))
    assert innovation(Estimate.of(prior), fix).residual[2] == pytest.approx(2.0 * math.pi - 6.2)
    assert abs(update(Estimate.of(prior), fix).pose.phi) == pytest.approx(math.pi)


def test_position_only_fix_measures_position_only():
    prior = PoseBelief(0, Pose2(0.0, 0.0, 0.5), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(1.0, -1.0, 2.0), np.diag([1.0, 1.0, math.inf]))
    news = innovation(Estimate.of(prior), fix)
    assert news.dof == 2
    assert news.nis == pytest.approx(1.0)
    posterior = update(Estimate.of(prior), fix).belief
    assert posterior.pose.as_array() == pytest.approx([0.5, -0.5, 0.5])
    assert posterior.covariance == pytest.approx(np.diag([0.5, 0.5, 0.04]))


def test_heading_only_fix_measures_heading_only():
    prior = PoseBelief(0, Pose2(3.0, 4.0, 3.1), np.diag([1.0, 1.0, 0.04]))
    fix = PoseBelief(0, Pose2(0.0, 0.0, -3.1), np.diag([math.inf, math.inf, 0.04]))
    assert innovation(Estimate.of(prior), fix).dof == 1
    posterior = update(Estimate.of(prior), fix).belief
    assert (posterior.pose.x, posterior.pose.y) == (3.0, 4.0)
    assert abs(posterior.pose.phi) == pytest.approx(math.pi)


@pytest.mark.parametrize(("stds", "dof"), [((1.0, 1.0, 1.0), 3), ((1.0, 1.0, math.inf), 2)])
def test_gate_is_the_chi_square_quantile(stds, dof):
    prior = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag([3.0, 3.0, 3.0]))
    edge = 2.0 * math.sqrt(chi2.ppf(0.999, dof))  # S is 4 in every component
    for factor, inside in ((0.999, True), (1.001, False)):
        fix = PoseBelief(0, Pose2(factor * edge, 0.0, 0.0), np.diag(np.square(stds)))
        assert innovation(Estimate.of(prior), fix).inside(0.999) is inside


def test_filter_is_honest_over_simulated_drives(simulate):
    runs = 40
    total = 0.0
    for seed in range(runs):
        drive = simulate(seed, steps=60)
        belief, fixes = Estimate.of(drive.initial), {fix.stamp_ns: fix for fix in drive.fixes}
        for step in drive.steps:
            for stamp_ns in sorted({step.start_ns + 50_000_000, step.stamp_ns}):
                belief = predict(belief, step.part(belief.stamp_ns, stamp_ns))
                if stamp_ns in fixes:
                    belief = update(belief, fixes[stamp_ns])
        total += drive.nees(belief.belief)
    assert chi2.ppf(0.005, 3 * runs) < total < chi2.ppf(0.995, 3 * runs)


ERRORS = np.array([[0.01, 0.02, 0.0, 0.0], [-0.02, 0.03, 0.01, 0.0], [0.0, 0.0, 0.0, 0.05]])


def test_prediction_is_linearized_as_it_moves():
    """F, read off the covariance of a small prior, against differences of the mean, parameters included."""
    step = OdometryStep(0, 1, 0.7, 0.4, np.zeros((2, 2)), 0.0, ERRORS, 0.05)
    mean = np.array([1.0, -2.0, 0.8, 0.3, -0.5, 1.2, -0.7])
    size, h = 3 + PARAMETERS, 1e-6
    joint = predict(Estimate(0, mean.copy(), np.eye(size), np.zeros((3, 3))), step).joint
    slopes = np.zeros((size, size))
    for i, shift in enumerate(h * np.eye(size)):
        ahead, behind = (
            predict(Estimate(0, mean + sign * shift, np.eye(size), np.zeros((3, 3))), step)
            for sign in (1, -1)
        )
        slopes[:, i] = (ahead.mean - behind.mean) / (2.0 * h)
    forgotten = np.diag([0.0] * 3 + [1.0 - math.exp(-0.1)] * PARAMETERS)
    assert joint == pytest.approx(slopes @ slopes.T + forgotten, abs=1e-8)


def test_a_wheel_that_is_too_small_is_found_out():
    """The left wheel 1 % larger than the file says: fixes on the true way show it, and little else."""
    true, told = WheelGeometry(0.0505, 0.05, 0.3), WheelGeometry(0.05, 0.05, 0.3, 5e-4, 5e-4, 3e-3)
    noise = OdometryNoise(wheel_m2_per_m=1e-7, swerve_radps2=0.0, memory_s=1e6)
    pose = Pose2(0.0, 0.0, 0.0)
    estimate = Estimate.of(PoseBelief(0, pose, 1e-6 * np.eye(3)))
    for i in range(40):
        turns = (6.0, 6.0 + 2.0 * math.sin(i))
        times = (i * SECOND_NS, (i + 1) * SECOND_NS)
        pose = advance(pose, wheel_step(*times, *turns, true, noise))
        estimate = predict(estimate, wheel_step(*times, *turns, told, noise))
        estimate = update(estimate, PoseBelief(times[1], pose, 1e-6 * np.eye(3)))
    assert estimate.mean[3:] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=0.1)
    assert math.sqrt(estimate.joint[3, 3]) < 0.1


def test_parameters_forget_but_never_know_less_than_before_the_first_fix():
    estimate = Estimate(0, np.full(7, 1.0), 0.01 * np.eye(7), np.zeros((3, 3)))
    for i in range(100):
        estimate = predict(estimate, OdometryStep(i, i + 1, 0.0, 0.0, np.zeros((2, 2)), forgetting=0.1))
    assert estimate.mean[3:] == pytest.approx([math.exp(-10.0)] * 4)
    assert np.diag(estimate.joint)[3:] == pytest.approx([1.0] * 4)


def slid(off: float, slip: float) -> tuple[Estimate, PoseBelief]:
    """A step of a metre, known to 1 cm, and a fix that says it was `off` longer."""
    step = OdometryStep(0, 1, 1.0, 0.0, np.diag([1e-4, 1e-6]), 1e-6, slip=slip)
    estimate = predict(Estimate.of(PoseBelief(0, Pose2(0.0, 0.0, 0.0), 1e-6 * np.eye(3))), step)
    return estimate, PoseBelief(1, Pose2(1.0 + off, 0.0, 0.0), np.diag([1e-4, 1e-4, 1e-4]))


def test_a_slip_explains_what_odometry_cannot():
    estimate, fix = slid(0.12, slip=30.0)
    news = innovation(estimate, fix)
    assert news.slipped
    assert news.inside(0.99)
    after = update(estimate, fix, news)
    assert after.pose.x == pytest.approx(1.12, abs=0.01)
    assert not after.slip.any()
    assert not innovation(*slid(0.12, slip=0.0)).inside(0.999)


def test_wide_is_as_wide_as_a_slip_asks():
    estimate, _ = slid(0.0, slip=30.0)
    added = estimate.wide.covariance - estimate.belief.covariance
    assert added == pytest.approx(estimate.slip * chi2.ppf(0.99, 1) / chi2.ppf(0.999, 1))
    assert added[0, 0] > 1e-3


def test_a_slip_explains_neither_the_ordinary_nor_everything():
    assert not innovation(*slid(0.02, slip=30.0)).slipped
    far = innovation(*slid(0.5, slip=30.0))
    assert far.slipped
    assert not far.inside(0.999)
