"""The evaluation against cases worked out by hand."""

import dataclasses
import json
import math

import numpy as np
import pytest

from localization.states import State
from maps.outcomes import Fix, PoseBelief
from maps.poses import Pose2
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.runlog import NullLog, Trajectory
from runs.runner import RunResult, StateSpan, run_session
from runs.session import RecordedFix, read_session
from runs.tracks import errors_of

TRUTH = Trajectory(np.array([0, 1_000_000_000]), np.array([[0.0, 0.0, 3.0], [2.0, 0.0, -3.0]]))


def track(*rows):
    """Return a trajectory of (seconds, x, y, phi, variance)."""
    return Trajectory.of_beliefs(
        [
            PoseBelief(round(s * 1e9), Pose2(x, y, phi), np.eye(3) * variance)
            for s, x, y, phi, variance in rows
        ]
    )


@pytest.fixture
def result(toy):
    return run_session(read_session(toy), RunConfig(), NullLog(), lambda *_: None)


def with_fixes(toy, *changes):
    """Return session and result of the toy with its fixes displaced by (dx, dphi, std)."""
    session = read_session(toy)
    fixes = []
    for fix, (dx, dphi, std) in zip(session.fixes, changes, strict=False):
        old = fix.fix.belief
        pose = Pose2(old.pose.x + dx, old.pose.y, old.pose.phi + dphi)
        belief = PoseBelief(old.stamp_ns, pose, np.diag([std**2, 0.05**2, 0.02**2]))
        fixes.append(RecordedFix(fix.stamp_ns, fix.arrival_ns, Fix(belief)))
    session = dataclasses.replace(session, fixes=tuple(fixes))
    return session, run_session(session, RunConfig(), NullLog(), lambda *_: None)


def test_truth_is_interpolated_the_short_way_and_not_beyond():
    errors = errors_of(track((-0.1, 0, 0, 0, 1), (0.25, 0.5, 0.3, 3.0, 1), (1.1, 2, 0, 0, 1)), TRUTH)
    assert np.isnan(errors.position_m[[0, 2]]).all()
    assert errors.position_m[1] == pytest.approx(0.3)
    assert errors.heading_rad[1] == pytest.approx((2 * math.pi - 6.0) / 4)


def test_anees_is_the_mean_over_the_dimension():
    errors = errors_of(track((0.0, 0.2, 0, 3.0, 0.04), (1.0, 2.0, 0.4, -3.0, 0.04)), TRUTH)
    assert errors.anees() == pytest.approx((1 / 3 + 4 / 3) / 2)


def test_without_true_heading_the_dimension_is_two():
    truth = Trajectory(TRUTH.stamps_ns, TRUTH.poses * [1, 1, math.nan])
    errors = errors_of(track((0.0, 0.2, 0, 3.0, 0.04)), truth)
    assert errors.anees() == pytest.approx(1 / 2)
    assert np.isnan(errors.heading_rad).all()


def test_perfect_run(toy, result):
    metrics = evaluate(read_session(toy), result, read_truth(toy))
    vision = metrics["vision"]
    assert (vision["attempted"], vision["fixes"], vision["accepted"], vision["wrong"]) == (8, 8, 8, 0)
    assert vision["position_error_m"]["max"] < 1e-3
    assert metrics["filtered"]["heading_error_deg"]["rmse"] < 0.05
    assert metrics["smoothed"]["anees"] < 0.1
    assert sum(metrics["states"].values()) == pytest.approx(8.0)
    assert (metrics["availability"], metrics["tracking_wrong_s"]) == (1.0, 0.0)
    assert metrics["timing_ms"]["fix"] == {"median": None, "p95": None}
    assert metrics["timing_ms"]["predict"]["median"] > 0.0


def test_without_truth_every_key_is_there(toy, result):
    session = read_session(toy)
    known, unknown = evaluate(session, result, read_truth(toy)), evaluate(session, result, None)
    nothing = {"median": None, "p95": None, "max": None, "rmse": None}
    for track_name in ("vision", "odometry", "filtered", "smoothed"):
        assert unknown[track_name].keys() == known[track_name].keys()
        assert unknown[track_name]["position_error_m"] == nothing
        assert unknown[track_name]["heading_error_deg"] == nothing
    assert unknown.keys() == known.keys()
    assert unknown["vision"]["wrong"] is unknown["vision"]["wrong_accepted"] is None
    assert unknown["vision"]["anees"] is unknown["filtered"]["anees"] is None
    assert unknown["tracking_wrong_s"] is None
    assert unknown["vision"]["accepted"] == 8
    json.dumps(unknown, allow_nan=False)


def test_wrong_fixes_are_counted_and_not_hidden(toy):
    good, far, turned = (0.0, 0.0, 0.05), (0.31, 0.0, 0.05), (0.0, math.radians(5.1), 0.05)
    near = (0.29, math.radians(4.9), 0.05)
    session, result = with_fixes(toy, good, far, turned, near)
    vision = evaluate(session, result, read_truth(toy))["vision"]
    assert (vision["fixes"], vision["partial"], vision["wrong"]) == (4, 0, 2)
    assert vision["position_error_m"]["max"] == pytest.approx(0.31, abs=1e-3)
    squares = [0.0, (0.31 / 0.05) ** 2, (math.radians(5.1) / 0.02) ** 2]
    squares.append((0.29 / 0.05) ** 2 + (math.radians(4.9) / 0.02) ** 2)
    assert vision["anees_all"] == pytest.approx(sum(squares) / 12, rel=0.01)
    assert vision["anees"] == pytest.approx((squares[0] + squares[3]) / 6, rel=0.01)


def test_partial_fix_is_wrong_outside_its_own_ellipse(toy):
    # 99.9 % of a chi-square with three degrees is 16.27: 4.03 standard deviations.
    session, result = with_fixes(toy, (0.6, 0.0, 0.2), (0.85, 0.0, 0.2))
    vision = evaluate(session, result, read_truth(toy))["vision"]
    assert (vision["fixes"], vision["partial"], vision["wrong"]) == (0, 2, 1)
    assert vision["position_error_m"]["max"] is None


def test_accepted_wrong_fix(toy):
    session, _ = with_fixes(toy, (0.4, 0.0, 0.1))
    loose = PoseBelief(0, session.initial.pose, np.diag([1.0, 1.0, 0.01]))
    session = dataclasses.replace(session, initial=loose)
    result = run_session(session, RunConfig(), NullLog(), lambda *_: None)
    vision = evaluate(session, result, read_truth(toy))["vision"]
    assert (vision["wrong"], vision["wrong_accepted"]) == (1, 1)


def test_longest_time_tracking_while_wrong(toy, result):
    poses = result.trajectories.filtered.poses.copy()
    poses[20:30, 0] += 0.6
    poses[50:90, 2] += math.radians(11.0)
    poses[120:125, 0] += 0.4
    filtered = dataclasses.replace(result.trajectories.filtered, poses=poses)
    spans = [
        dataclasses.replace(span, state=State.UNCERTAIN if place == 60 else State.TRACKING)
        for place, span in enumerate(result.spans)
    ]
    result = RunResult(
        dataclasses.replace(result.trajectories, filtered=filtered),
        *(result.records, result.outcomes, tuple(spans), result.predict_ms),
    )
    metrics = evaluate(read_session(toy), result, read_truth(toy))
    assert metrics["tracking_wrong_s"] == pytest.approx(29 * 0.05)
    assert metrics["states"]["UNCERTAIN"] == pytest.approx(0.05)


def test_availability(toy, result):
    lost = [StateSpan(0, 3, State.LOST), StateSpan(3, 12, State.TRACKING)]
    result = dataclasses.replace(result, spans=tuple(lost))
    assert evaluate(read_session(toy), result, None)["availability"] == pytest.approx(0.75)


def test_dense_truth_goes_before_the_sparse_and_phi_may_be_empty(toy):
    (toy / "ground_truth.csv").write_text("timestamp_s,x_m,y_m,phi_rad\n0,7,8,\n")
    assert len(read_truth(toy)) == 161
    (toy / "ground_truth_dense.csv").unlink()
    truth = read_truth(toy)
    assert truth.poses[0, :2].tolist() == [7.0, 8.0]
    assert np.isnan(truth.poses[0, 2])
    (toy / "ground_truth.csv").unlink()
    assert read_truth(toy) is None


def test_observable_frames(sample, result):
    session = read_session(sample)
    records = [
        dataclasses.replace(record, filename=frame.filename)
        for record, frame in zip(result.records, session.frames, strict=False)
    ]
    result = dataclasses.replace(result, records=tuple(records))
    vision = evaluate(session, result, None)["vision"]
    assert (vision["observable_frames"], vision["fixes_in_observable"]) == (45, 8)
