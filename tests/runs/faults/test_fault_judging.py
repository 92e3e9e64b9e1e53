"""What is counted of a run with a fault: how long it is wrong unawares, looks until it is right again, or lost."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from localization.states import State
from maps.outcomes import PoseBelief
from maps.poses import Pose2
from runs.diary import StateSpan
from runs.faults.judging import judged, judged_undisturbed, wrong_unawares_s
from runs.faults.kinds import FAULTS, corrupted, fault_span
from runs.faults.recording import Span, read_recording
from runs.runlog import Trajectory

S = 10**9
#: The toy's fixes are at n + 0.33 s; the truth stands at the origin.
STAMPS = [round((second + 0.33) * S) for second in range(8)]


@pytest.fixture
def recording(toy):
    return read_recording(toy)


NO_FIXES = (None,) * len(STAMPS)


def run(states, errors_m, fixes_m=NO_FIXES):
    """Make a run whose looks end in these states with these errors; None: nothing was said.

    `fixes_m`: errors of the fixes accepted, None for none.
    """
    records = [
        SimpleNamespace(
            stamp_ns=stamp,
            arrival_ns=stamp,
            state=state,
            x_m=error,
            y_m=None if error is None else 0.0,
            phi_rad=None if error is None else 0.0,
            accepted=fix is not None,
            fix_x_m=fix,
            fix_y_m=0.0,
            fix_phi_rad=0.0,
        )
        for stamp, state, error, fix in zip(STAMPS, states, errors_m, fixes_m, strict=True)
    ]
    beliefs = [
        PoseBelief(record.stamp_ns, Pose2(record.x_m, 0.0, 0.0), np.eye(3))
        for record in records
        if record.x_m is not None
    ]
    track = Trajectory.of_beliefs(beliefs)
    return SimpleNamespace(records=tuple(records), spans=(), trajectories=SimpleNamespace(filtered=track))


def judge(recording, states, errors_m, end=3.0, **made):
    truth = Trajectory(np.array([0, 100 * S]), np.zeros((2, 3)))
    return judged(recording, Span(S, round(end * S)), run(states, errors_m, **made), truth)


TRACKING, LOST = ["TRACKING"] * 8, ["LOST"] * 8


def test_a_run_that_is_right_throughout(recording):
    judgement = judge(recording, TRACKING, [0.0] * 8)
    assert (judgement.wrong_looks, judgement.recovered_after, judgement.lost_after) == (0, 1, None)


def test_a_robot_is_astray_from_the_last_right_fix_until_it_is_lost(recording):
    states = [*["TRACKING"] * 5, "LOST", "LOST", "TRACKING"]
    errors = [0.0, 0.0, 0.0, 2.0, 2.0, None, None, 2.0]
    right = [0.1, None, 0.1, 2.0, None, None, None, 0.1]
    judgement = judge(recording, states, errors, fixes_m=right)
    assert (judgement.lost_after, judgement.astray) == (6, 3)
    assert judge(recording, states, errors).astray == 6
    assert judge(recording, TRACKING, [0.0] * 8, fixes_m=right).astray is None


def test_wrong_looks_are_those_in_tracking_on_end(recording):
    errors = [0.0, 0.9, 0.9, 0.0, 0.9, None, 0.9, 0.9]
    assert judge(recording, TRACKING, errors).wrong_looks == 3
    assert judge(recording, LOST, errors).wrong_looks == 0


def test_recovery_counts_good_frames_from_the_faults_end(recording):
    errors = [0.0, 0.9, 0.9, 0.9, 0.9, 0.0, 0.0, 0.0]
    assert judge(recording, TRACKING, errors).recovered_after == 3
    assert judge(recording, LOST, errors).recovered_after is None
    # One that is wrong again after the next frame was not right.
    assert judge(recording, TRACKING, [0.0, 0.9, 0.9, 0.2, 0.9, 0.0, 0.2, 0.9]).recovered_after == 3
    # Nor is one that would not be wrong enough to be charged.
    assert judge(recording, TRACKING, [0.0, 0.9, 0.9, 0.4, 0.4, 0.4, 0.2, 0.2]).recovered_after == 4
    # A fault without an end is not recovered from.
    assert judge(recording, TRACKING, errors, end=100.0).recovered_after is None


def test_looks_after_the_fault_are_told_from_none(recording):
    errors = [0.0, *[0.9] * 7]
    # At 3.33 to 7.33 s; the toy ends at 8 s.
    assert judge(recording, TRACKING, errors, end=3.0).looks_after == 5
    assert judge(recording, LOST, errors, end=7.0).looks_after == 1
    # One that ends behind the last look leaves nothing to judge, nor does one without an end.
    assert judge(recording, TRACKING, [0.0] * 8, end=7.5).looks_after == 0
    assert judge(recording, TRACKING, [0.0] * 8, end=7.5).recovered_after is None
    assert judge(recording, TRACKING, errors, end=100.0).looks_after == 0
    assert judged(recording, Span(S, 3 * S), run(TRACKING, errors), None).looks_after is None


def test_the_first_lost_frame_is_counted_from_one(recording):
    states = [*TRACKING[:4], *LOST[:4]]
    assert judge(recording, states, [0.0] * 8).lost_after == 5


def steps(*parts):
    """Make odometry steps of 0.1 s, and the stamps at which the pose is wrong, of (seconds, state, wrong)."""
    spans, wrong, at = [], set(), 0
    for seconds, state, off in parts:
        for _ in range(round(10 * seconds)):
            spans.append(StateSpan(at, at + S // 10, state))
            at += S // 10
            if off:
                wrong.add(at)
    return spans, wrong


def test_a_wrong_pose_is_charged_from_the_third_look_since_it_went_wrong():
    looks = [round((second + 0.55) * S) for second in range(20)]
    # Wrong from 2.1 s on; looks at 2.55, 3.55 and 4.55 s; what the third brings is published at 4.6 s.
    spans, wrong = steps((2, State.TRACKING, False), (3, State.TRACKING, True), (5, State.TRACKING, False))
    assert wrong_unawares_s(spans, wrong, looks) == pytest.approx(0.5)
    assert wrong_unawares_s(spans, wrong, looks[:4]) == 0.0
    short, wrong = steps((2, State.TRACKING, False), (2.5, State.TRACKING, True), (5, State.TRACKING, False))
    assert wrong_unawares_s(short, wrong, looks) == 0.0


def test_looks_of_another_stretch_excuse_nothing_and_charge_nothing():
    looks = [round((second + 0.55) * S) for second in range(20)]
    stretch = ((2, State.TRACKING, True), (1, State.TRACKING, False))
    assert wrong_unawares_s(*steps(*stretch, *stretch, *stretch), looks) == 0.0


def test_who_knows_that_a_pose_is_bad_is_charged_once_he_trusts_it_again():
    looks = [round((second + 0.55) * S) for second in range(20)]
    unsure = steps((5, State.UNCERTAIN, True), (5, State.UNCERTAIN, False))
    assert wrong_unawares_s(*unsure, looks) == 0.0
    trusting = steps((5, State.UNCERTAIN, True), (0.4, State.TRACKING, True), (5, State.TRACKING, False))
    assert wrong_unawares_s(*trusting, looks) == pytest.approx(0.4)


def test_frames_that_a_fault_stamps_otherwise_still_count(sample):
    recording = read_recording(sample)
    span = fault_span(recording, FAULTS["clock-offset"])
    faulty = corrupted(recording, "clock-offset", span, 0)
    judgement = judged(faulty, span, wrong_all_along(faulty), TRUTH)
    assert (
        judgement.wrong_looks
        == judged_undisturbed(recording.session, wrong_all_along(recording), TRUTH).wrong_looks
    )
    assert judgement.wrong_looks > 10
    assert judgement.recovered_after is None


def test_pictures_in_which_a_fault_hides_the_edges_do_not_count(sample):
    recording = read_recording(sample)
    span = Span(recording.span.start_ns, recording.span.start_ns + 10 * S)
    faulty = corrupted(recording, "blackout", span, 0)
    result = wrong_all_along(faulty)
    hidden, seen = judged(faulty, span, result, TRUTH, obscured=True), judged(faulty, span, result, TRUTH)
    assert 3 <= seen.wrong_looks - hidden.wrong_looks <= 9


def test_looks_after_the_fault_count_where_something_was_to_be_seen(sample):
    recording = read_recording(sample)
    middle_ns = (recording.span.start_ns + recording.span.end_ns) // 2
    span, result = Span(recording.span.start_ns, middle_ns), wrong_all_along(recording)
    later = sum(frame.stamp_ns >= middle_ns for frame in recording.session.frames)
    seen = judged(recording, span, result, TRUTH).looks_after
    assert seen is not None
    assert 5 <= seen < later


#: Somewhere else than any robot.
TRUTH = Trajectory(np.array([-S, 1000 * S]), np.full((2, 3), 500.0))


def wrong_all_along(recording):
    """Make a run that is at the origin, and trusts it, after every frame."""
    records = [
        SimpleNamespace(
            stamp_ns=frame.stamp_ns,
            arrival_ns=frame.arrival_ns,
            state="TRACKING",
            x_m=0.0,
            y_m=0.0,
            phi_rad=0.0,
        )
        for frame in recording.session.frames
    ]
    track = Trajectory(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    return SimpleNamespace(records=tuple(records), spans=(), trajectories=SimpleNamespace(filtered=track))
