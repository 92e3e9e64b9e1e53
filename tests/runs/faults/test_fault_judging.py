"""What is counted of a run with a fault: wrong looks on end, frames until right again, frames until lost."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from maps.outcomes import PoseBelief
from maps.poses import Pose2
from runs.faults.judging import judged
from runs.faults.recording import Span, read_recording
from runs.runlog import Trajectory

S = 10**9
#: The toy's fixes are at n + 0.33 s; the truth stands at the origin.
STAMPS = [round((second + 0.33) * S) for second in range(8)]


@pytest.fixture
def recording(toy):
    return read_recording(toy)


def run(states, errors_m):
    """Make a run whose looks end in these states with these errors; None: nothing was said."""
    records = [
        SimpleNamespace(
            stamp_ns=stamp,
            state=state,
            x_m=error,
            y_m=None if error is None else 0.0,
            phi_rad=None if error is None else 0.0,
        )
        for stamp, state, error in zip(STAMPS, states, errors_m, strict=True)
    ]
    beliefs = [
        PoseBelief(record.stamp_ns, Pose2(record.x_m, 0.0, 0.0), np.eye(3))
        for record in records
        if record.x_m is not None
    ]
    track = Trajectory.of_beliefs(beliefs)
    return SimpleNamespace(records=tuple(records), spans=(), trajectories=SimpleNamespace(filtered=track))


def judge(recording, states, errors_m, end=3.0):
    truth = Trajectory(np.array([0, 100 * S]), np.zeros((2, 3)))
    return judged(recording, Span(S, round(end * S)), run(states, errors_m), truth)


TRACKING, LOST = ["TRACKING"] * 8, ["LOST"] * 8


def test_a_run_that_is_right_throughout(recording):
    judgement = judge(recording, TRACKING, [0.0] * 8)
    assert (judgement.wrong_looks, judgement.recovered_after, judgement.lost_after) == (0, 1, None)


def test_wrong_looks_are_those_in_tracking_on_end(recording):
    errors = [0.0, 0.9, 0.9, 0.0, 0.9, None, 0.9, 0.9]
    assert judge(recording, TRACKING, errors).wrong_looks == 3
    assert judge(recording, LOST, errors).wrong_looks == 0


def test_recovery_counts_good_frames_from_the_faults_end(recording):
    errors = [0.0, 0.9, 0.9, 0.9, 0.9, 0.0, 0.0, 0.0]
    assert judge(recording, TRACKING, errors).recovered_after == 3
    assert judge(recording, LOST, errors).recovered_after is None
    # A fault without an end is not recovered from.
    assert judge(recording, TRACKING, errors, end=100.0).recovered_after is None


def test_the_first_lost_frame_is_counted_from_one(recording):
    states = [*TRACKING[:4], *LOST[:4]]
    assert judge(recording, states, [0.0] * 8).lost_after == 5
