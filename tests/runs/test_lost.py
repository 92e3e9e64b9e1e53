"""Robots that are lost, moved unawares or blind: simulated fixes always, rendered sessions in the slow tests."""

import dataclasses

import numpy as np
import pytest
from splicing import covered, moved_unawares, observable_frames

from maps.outcomes import Ambiguous, Fix, PoseBelief
from maps.poses import Pose2
from runs.config import RunConfig
from runs.evaluation import WRONG_FIX_M, evaluate, read_truth
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import RecordedFix, read_session
from runs.simulation.fixes import FixErrors
from runs.simulation.synthetic import SessionPlan, simulate_session
from runs.tracks import errors_of, interpolate

CONFIG = RunConfig()
RENDERED = ("building_a", "building_b", "building_0001", "building_0001_return", "building_0002")


def run(session):
    return run_session(session, CONFIG, NullLog(), lambda *_: None)


def lost(session):
    return dataclasses.replace(session, initial=None)


def first_error(result, truth):
    """Return the stamp, the position error [m] and the heading error [rad] of the first published pose."""
    track = result.trajectories.filtered
    errors = errors_of(track, truth)
    return int(track.stamps_ns[0]), errors.position_m[0], errors.heading_rad[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_lost_robot_finds_itself_among_outliers(seed):
    plan = SessionPlan(seconds=30.0, fixes=FixErrors(outlier_share=0.2, delay_s=(0.05, 0.6)))
    simulated = simulate_session(np.random.default_rng(seed), plan)
    result = run(lost(simulated.session))
    stamp_ns, position_m, heading_rad = first_error(result, simulated.drive.truth())
    assert stamp_ns - simulated.session.start_ns < 10e9
    assert position_m < 0.3
    assert heading_rad < np.radians(6.0)
    metrics = evaluate(simulated.session, result, simulated.drive.truth())
    assert metrics["tracking_wrong_s"] == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_moved_by_five_metres_and_a_quarter_turn(seed):
    """From halfway on all fixes are those of a robot that somebody carried away."""
    simulated = simulate_session(np.random.default_rng(seed), SessionPlan(seconds=40.0))
    session, carried = simulated.session, Pose2(5.0, 0.0, 0.5 * np.pi)
    fixes = [carried_off(fix, carried) if fix.stamp_ns > 20e9 else fix for fix in session.fixes]
    result = run(dataclasses.replace(session, fixes=tuple(fixes)))
    after = [record for record in result.records if record.stamp_ns > 20e9]
    assert "TRACKING" not in [record.state for record in after[2:3]] or after[2].verdict == "RELOCALIZED"
    relocalized = next(number for number, record in enumerate(after) if record.verdict == "RELOCALIZED")
    assert relocalized < 8
    true = carried @ Pose2.from_array(simulated.drive.at(np.array([after[-1].stamp_ns]))[0])
    assert np.hypot(after[-1].x_m - true.x, after[-1].y_m - true.y) < 0.3


def carried_off(fix, carried):
    belief = fix.fix.belief
    return RecordedFix(
        fix.stamp_ns,
        fix.arrival_ns,
        Fix(PoseBelief(belief.stamp_ns, carried @ belief.pose, belief.covariance)),
    )


@pytest.mark.parametrize("seed", range(3))
def test_twenty_seconds_without_a_fix(seed):
    """A covered camera: uncertain as soon as the ellipse says so, or nobody has confirmed for long; then back."""
    simulated = simulate_session(np.random.default_rng(seed), SessionPlan(seconds=45.0))
    fixes = [fix for fix in simulated.session.fixes if not 10e9 < fix.stamp_ns < 30e9]
    result = run(dataclasses.replace(simulated.session, fixes=tuple(fixes)))
    states = {span.stamp_ns: span.state.value for span in result.spans}
    assert {state for at, state in states.items() if 5e9 < at < 10e9} == {"TRACKING"}
    assert {state for at, state in states.items() if 21e9 < at < 30e9} == {"UNCERTAIN"}
    assert {state for at, state in states.items() if at > 33e9} == {"TRACKING"}
    assert evaluate(simulated.session, result, simulated.drive.truth())["tracking_wrong_s"] == 0.0


def test_two_buildings_alike_are_told_apart_by_one_room():
    """All looks fit two places five metres apart, but for those of a few seconds."""
    simulated = simulate_session(np.random.default_rng(1), SessionPlan(seconds=30.0))
    fixes = []
    for fix in simulated.session.fixes:
        belief, other = fix.fix.belief, Pose2(5.0, 0.0, 0.0) @ fix.fix.belief.pose
        twin = PoseBelief(belief.stamp_ns, other, belief.covariance)
        sure = 15e9 < fix.stamp_ns < 20e9
        outcome = fix.fix if sure else Ambiguous((twin, belief), (0.6, 0.4))
        fixes.append(RecordedFix(fix.stamp_ns, fix.arrival_ns, outcome))
    truth = simulated.drive.truth()
    result = run(lost(dataclasses.replace(simulated.session, fixes=tuple(fixes))))
    stamp_ns, position_m, _ = first_error(result, truth)
    assert 15e9 < stamp_ns < 19e9
    assert position_m < 0.3
    # The right one is kept afterwards.
    assert errors_of(result.trajectories.filtered, truth).position_m.max() < 0.4


@pytest.mark.slow
@pytest.mark.parametrize("name", RENDERED)
def test_rendered_session_without_a_pose(data, name):
    folder = data / "rendered" / name
    session, truth = read_session(folder), read_truth(folder)
    result = run(lost(session))
    stamp_ns, position_m, heading_rad = first_error(result, truth)
    assert position_m < 0.1
    assert heading_rad < np.radians(2.0)
    names, seen = observable_frames(folder), [r for r in result.records if r.stamp_ns <= stamp_ns]
    assert sum(record.filename in names for record in seen) <= 10
    assert evaluate(session, result, truth)["tracking_wrong_s"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cut_s", "gone_s"),
    [
        ("building_a", 25.0, 30.0),
        ("building_b", 10.0, 20.0),
        ("building_0001", 16.0, 14.0),
        ("building_0001_return", 16.0, 20.0),
        ("building_0002", 24.0, 14.0),
        ("building_b", 24.0, 14.0),
        # Moved by more than five metres and a quarter turn.
        ("building_0002", 10.0, 20.0),
        # What is believed drives through a wall, where nothing is to be expected.
        ("building_b", 16.0, 20.0),
        # The first images at the new place fit two.
        ("building_0002", 16.0, 30.0),
        # Most frames after the cut show too little for a search of the floor.
        ("building_a", 16.0, 14.0),
    ],
)
def test_rendered_robot_moved_unawares(data, name, cut_s, gone_s):
    """After three observable frames it is not tracking, or right; it is right within five more."""
    folder = data / "rendered" / name
    session, truth = moved_unawares(folder, cut_s, gone_s)
    names = observable_frames(folder)
    result = run(session)
    after = [record for record in result.records if record.stamp_ns >= cut_s * 1e9]
    seen = [record for record in after if record.filename in names]
    assert seen[2].state != "TRACKING" or error_of(seen[2], truth) < 0.1
    found = next(number for number, record in enumerate(after) if record.verdict == "RELOCALIZED")
    assert sum(record.filename in names for record in after[: found + 1]) <= 8
    assert error_of(after[found], truth) < 0.1
    # Then the filter goes on, stretches without fixes included.
    published = [record for record in after[found:] if record.state != "LOST"]
    assert max(error_of(record, truth) for record in published) < WRONG_FIX_M
    # No longer than three frames take to come.
    assert evaluate(session, result, truth)["tracking_wrong_s"] < seen[2].stamp_ns / 1e9 - cut_s + 0.1


def error_of(record, truth):
    at = interpolate(np.array([record.stamp_ns]), truth)[0]
    return np.hypot(record.x_m - at[0], record.y_m - at[1])


@pytest.mark.slow
def test_rendered_session_with_a_covered_camera(data, tmp_path):
    folder = data / "rendered" / "building_0002"
    session, truth = covered(folder, tmp_path, 5.0, 25.0), read_truth(folder)
    result = run(session)
    states = {record.stamp_ns: record.state for record in result.records}
    blind = [state for stamp_ns, state in states.items() if 16e9 < stamp_ns < 25e9]
    assert set(blind) == {"UNCERTAIN"}
    assert "LOST" not in states.values()
    assert [state for stamp_ns, state in states.items() if 30e9 < stamp_ns < 31e9] == ["TRACKING"]
    assert evaluate(session, result, truth)["tracking_wrong_s"] == 0.0
