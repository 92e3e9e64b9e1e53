"""The smoother on simulated sessions: gross outliers, honesty, the fixed lag; and on the development data."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from localization.odometry import OdometryNoise, OdometryStep
from localization.smoother import smooth
from maps.poses import wrap_angle
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import read_session
from runs.simulation.fixes import FixErrors
from runs.simulation.synthetic import SessionPlan, simulate_session

PLAN = SessionPlan(seconds=60.0, fixes=FixErrors(rate_hz=2.0, outlier_share=0.2))


def squares(seeds: Iterable[int], plan: SessionPlan = PLAN) -> tuple[float, float, float]:
    """Return the mean squared position errors with and without the outliers, and ANEES with them."""
    spoilt, clean, nees = list[float](), list[float](), list[float]()
    for seed in seeds:
        drawn = simulate_session(np.random.default_rng(seed), plan)
        session = drawn.session
        assert session.initial is not None
        steps = [event for event in session.events(OdometryNoise()) if isinstance(event, OdometryStep)]
        fixes = [fix.fix.belief for fix in session.fixes]
        good = [fix for fix, wrong in zip(fixes, drawn.outliers, strict=True) if not wrong]
        for found, errors in ((fixes, spoilt), (good, clean)):
            beliefs = smooth(session.initial, steps, found).beliefs[::25]
            stamps_ns = np.array([belief.stamp_ns for belief in beliefs])
            off = np.array([belief.pose.as_array() for belief in beliefs]) - drawn.drive.at(stamps_ns)
            off[:, 2] = wrap_angle(off[:, 2])
            errors.append(float(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2)))
            if found is fixes:
                nees += [
                    float(e @ np.linalg.solve(b.covariance, e)) / 3 for e, b in zip(off, beliefs, strict=True)
                ]
    return float(np.mean(spoilt)), float(np.mean(clean)), float(np.mean(nees))


def test_three_sessions_with_outliers():
    spoilt, clean, anees = squares(range(3), SessionPlan(seconds=30.0, fixes=PLAN.fixes))
    assert math.sqrt(spoilt / clean) < 1.25
    assert 0.3 < anees < 2.0


@pytest.mark.slow
def test_a_fifth_of_gross_outliers_changes_the_result_by_less_than_a_tenth():
    spoilt, clean, anees = squares(range(50))
    ratio = math.sqrt(spoilt / clean)
    print(f"\n50 sessions: RMSE {math.sqrt(spoilt):.4f} m, without outliers {math.sqrt(clean):.4f} m, "
          f"ratio {ratio:.3f}, ANEES {anees:.2f}")  # fmt: skip
    assert ratio < 1.1
    assert 0.5 < anees < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mrclam_6_1", "mrclam_7_1", "lost_in_the_woods", "labyrinth"])
def test_recorded_odometry(data, name):
    session = read_session(data / "real_odometry" / name)
    result = run_session(session, RunConfig(), NullLog(), lambda *_: None)
    metrics = evaluate(session, result, read_truth(session.folder))
    filtered, lag, smoothed = (
        metrics[track]["position_error_m"]["rmse"] for track in ("filtered", "fixed_lag", "smoothed")
    )
    assert smoothed <= 0.7 * filtered
    assert smoothed < lag < filtered
