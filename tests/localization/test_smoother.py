import itertools
import logging
import math
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from localization.ekf import Estimate, innovation, predict, update
from localization.lasting import JointConfig
from localization.odometry import OdometryStep, advance
from localization.smoother import SmootherConfig, smooth
from maps.outcomes import PoseBelief
from maps.poses import Pose2


def filtered(drive):
    """The filter's beliefs at every step's end, fixes fused that pass its gate."""
    estimate, waiting, beliefs = Estimate.of(drive.initial), list(drive.fixes), [drive.initial]
    for step in drive.steps:
        while waiting and waiting[0].stamp_ns <= step.stamp_ns:
            fix = waiting.pop(0)
            estimate = predict(estimate, step.part(estimate.stamp_ns, fix.stamp_ns))
            news = innovation(estimate, fix)
            estimate = update(estimate, fix, news) if news.inside(0.999) else estimate
        estimate = predict(estimate, step.part(estimate.stamp_ns, step.stamp_ns))
        beliefs.append(estimate.belief)
    return beliefs


def smoothed(*args, **kwargs):
    return smooth(*args, **kwargs).beliefs


def reckoned(drive):
    pose, beliefs = drive.initial.pose, []
    for step in drive.steps:
        pose = advance(pose, step)
        beliefs.append(PoseBelief(step.stamp_ns, pose, np.eye(3)))
    return beliefs


def test_smoother_beats_the_filter(simulate):
    drives = [simulate(seed) for seed in range(4)]
    before = np.mean([drive.error(filtered(drive)) for drive in drives])
    after = np.mean([drive.error(smoothed(drive.initial, drive.steps, drive.fixes)) for drive in drives])
    assert after < 0.8 * before


def test_beliefs_at_every_stamp_symmetric_and_positive(simulate):
    drive = simulate(0)
    beliefs = smoothed(drive.initial, drive.steps, drive.fixes)
    assert [belief.stamp_ns for belief in beliefs] == [0, *(step.stamp_ns for step in drive.steps)]
    for belief in beliefs:
        assert np.allclose(belief.covariance, belief.covariance.T)
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0


def test_outliers_change_little(simulate):
    for seed in range(3):
        clean, spoilt = simulate(seed, fix_every=5), simulate(seed, fix_every=5, outlier_share=0.25)
        assert len(spoilt.outliers) >= 4
        error = spoilt.error(smoothed(spoilt.initial, spoilt.steps, spoilt.fixes))
        assert error < 1.5 * clean.error(smoothed(clean.initial, clean.steps, clean.fixes)) + 0.02


def test_refused_fixes_are_the_wrong_ones(simulate):
    drive = simulate(3, fix_every=5, outlier_share=0.2)
    refused = smooth(drive.initial, drive.steps, drive.fixes).refused
    assert {id(fix) for fix in drive.outliers} == {id(fix) for fix in refused}


def test_smoother_is_honest_over_simulated_drives(simulate):
    """Fixes of 0.2 m and 0.03 m in x and y show every covariance left in the wrong frame."""
    runs, total = 24, 0.0
    for seed in range(runs):
        drive = simulate(seed, steps=60)
        total += drive.nees(smoothed(drive.initial, drive.steps, drive.fixes)[30])
    assert chi2.ppf(0.005, 3 * runs) < total < chi2.ppf(0.995, 3 * runs)


def test_position_only_fixes(simulate):
    drives = [simulate(seed, fix_stds=(0.05, 0.05, math.inf)) for seed in range(4)]
    after = [drive.error(smoothed(drive.initial, drive.steps, drive.fixes)) for drive in drives]
    assert np.mean(after) < 0.5 * np.mean([drive.error(reckoned(drive)) for drive in drives])


def test_unknown_heading_from_a_guess(simulate):
    drive = simulate(0, fix_stds=(0.05, 0.05, math.inf))
    covariance = np.array(drive.initial.covariance)
    covariance[2, 2] = math.inf
    headless = PoseBelief(0, Pose2(drive.initial.pose.x, drive.initial.pose.y, 0.0), covariance)
    with_heading = smoothed(drive.initial, drive.steps, drive.fixes)
    from_guess = smoothed(headless, drive.steps, drive.fixes, guess=filtered(drive)[100:])
    assert drive.error(from_guess) < 1.3 * drive.error(with_heading)


def test_heading_only_fix_and_fixes_outside(simulate):
    drive = simulate(0, steps=20)
    last = drive.steps[-1].stamp_ns
    outside = [PoseBelief(stamp_ns, Pose2(50.0, 50.0, 0.0), 1e-4 * np.eye(3)) for stamp_ns in (-1, last + 1)]
    phi = drive.truth[last].phi
    compass = PoseBelief(last, Pose2(0.0, 0.0, phi), np.diag([math.inf, math.inf, 1e-6]))
    beliefs = smoothed(drive.initial, drive.steps, [*outside, compass])
    assert beliefs[-1].pose.minus(drive.truth[last])[2] == pytest.approx(0.0, abs=4e-3)
    assert beliefs[-1].heading_std_rad < 2e-3


def test_no_fixes_is_dead_reckoning_with_the_filters_covariance(simulate):
    """Errors that last included: without fixes nothing is learnt of them."""
    drive = simulate(0, steps=40)
    steps = [replace(step, slip=0.0) for step in drive.steps]
    estimate = Estimate.of(drive.initial)
    for step in steps:
        estimate = predict(estimate, step)
    last = smoothed(drive.initial, steps, [])[-1]
    assert last.pose.minus(estimate.pose) == pytest.approx(np.zeros(3), abs=1e-6)
    assert last.covariance == pytest.approx(estimate.covariance, rel=0.05, abs=2e-3)


def test_odometry_is_as_wide_as_its_slips_ask(simulate):
    drive = simulate(0, steps=40)
    tight, wide = (
        smoothed(drive.initial, drive.steps, [], SmootherConfig(joint=JointConfig(slip_share=share)))[-1]
        for share in (0.0, 0.5)
    )
    assert np.linalg.eigvalsh(wide.covariance - tight.covariance).min() > 0.0


def test_no_steps_leave_the_initial_belief(simulate):
    initial = simulate(0, steps=1).initial
    assert smoothed(initial, [], []) == (initial,)


def test_a_failing_second_pass_leaves_the_first(simulate, monkeypatch, caplog):
    def fail(*_):
        raise RuntimeError("indeterminate")

    monkeypatch.setattr(gtsam, "GncLMOptimizer", fail)
    drive = simulate(0, outlier_share=0.1)
    with caplog.at_level(logging.WARNING):
        beliefs = smoothed(drive.initial, drive.steps, drive.fixes, SmootherConfig())
    assert "indeterminate" in caplog.text
    assert drive.error(beliefs) < 0.5


def test_holes_in_the_odometry_are_bridged(simulate):
    drive = simulate(0)
    holed = [step for step in drive.steps if not 5_000_000_000 < step.stamp_ns <= 6_000_000_000]
    beliefs = smoothed(drive.initial, holed, drive.fixes)
    assert beliefs[-1].stamp_ns == drive.steps[-1].stamp_ns
    assert drive.error(beliefs[-20:]) < 0.3


def test_no_jumps_at_the_nodes(simulate):
    """Odometry on an exact straight line, a fix at its end that says it was 10 % longer."""
    initial = simulate(0, steps=1).initial
    steps = [OdometryStep(i, i + 1, 0.1, 0.0, np.diag([1e-3, 1e-9])) for i in range(20)]
    x, y, phi = (initial.pose @ Pose2(2.2, 0.0, 0.0)).as_array()
    fix = PoseBelief(20, Pose2(x, y, phi), 1e-6 * np.eye(3))
    beliefs = smoothed(initial, steps, [fix], SmootherConfig(node_spacing_s=1.0))
    lengths = [
        np.linalg.norm(later.pose.minus(belief.pose)[:2]) for belief, later in itertools.pairwise(beliefs)
    ]
    assert lengths == pytest.approx([lengths[0]] * 20, abs=1e-6)
    assert lengths[0] > 0.101
