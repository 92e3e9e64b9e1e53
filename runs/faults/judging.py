"""What a fault did to a run: how long it was wrong unawares, how soon it was right again, when it gave up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from localization.states import State
from runs.evaluation import OBSERVABLE_EDGES, WRONG_POSE_M, WRONG_POSE_RAD, tracking_wrong_s
from runs.faults.recording import Recording, Span
from runs.runlog import StepRecord, Trajectory
from runs.runner import RunResult
from runs.tables import read_table
from runs.tracks import errors_of, interpolate

#: From this observable frame on, nothing excuses a wrong pose that is called right.
SETTLED = 3


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a fault did.

    `wrong_s`: longest time on end in TRACKING with the pose wrong, after the third observable frame.
    `wrong_looks`: most good frames on end after each of which the state is TRACKING and the pose wrong.
    `recovered_after`: good frames from the fault's end on until a pose is right and said to be, None where that
    never came or there was no end. `lost_after`: frames until the first LOST, None for never.
    """

    wrong_s: float | None
    wrong_looks: int | None
    recovered_after: int | None
    lost_after: int | None


def judged(original: Recording, span: Span, result: RunResult, truth: Trajectory | None) -> Judgement:
    """Judge a run of a session that a fault was done to; `original` tells which frames show enough.

    Frames count where they are observable, or all where nobody says.
    """
    lost = [at for at, record in enumerate(result.records, start=1) if record.state == State.LOST.value]
    if truth is None:
        return Judgement(None, None, None, lost[0] if lost else None)
    good = _good_stamps(original)
    track = result.trajectories.filtered
    since = sorted(good)[SETTLED - 1] if len(good) >= SETTLED else None
    wrong = tracking_wrong_s(result.spans, track, errors_of(track, truth), since)
    recovered = None if span.end_ns >= original.span.end_ns else _recovered(result, span, good, truth)
    return Judgement(wrong, _wrong_looks(result, good, truth), recovered, lost[0] if lost else None)


def _wrong_looks(result: RunResult, good: set[int], truth: Trajectory) -> int:
    longest = lasting = 0
    for record in result.records:
        if record.x_m is None:
            # Older than the filter remembers, or ahead of odometry: nothing was said of that moment.
            continue
        if record.state != State.TRACKING.value or _right(record, truth):
            lasting = 0
        elif record.stamp_ns in good:
            lasting += 1
            longest = max(longest, lasting)
    return longest


def _recovered(result: RunResult, span: Span, good: set[int], truth: Trajectory) -> int | None:
    after = [
        record for record in result.records if record.stamp_ns >= span.end_ns and record.stamp_ns in good
    ]
    return next((at for at, record in enumerate(after, start=1) if _right(record, truth)), None)


def _right(record: StepRecord, truth: Trajectory) -> bool:
    """Tell whether the belief after a frame is TRACKING and within what counts as right."""
    if (
        record.state != State.TRACKING.value
        or record.x_m is None
        or record.y_m is None
        or record.phi_rad is None
    ):
        return False
    x, y, phi = interpolate(np.array([record.stamp_ns]), truth)[0]
    far = math.hypot(record.x_m - x, record.y_m - y)
    turned = abs(math.remainder(record.phi_rad - phi, math.tau))
    return not (far > WRONG_POSE_M or turned > WRONG_POSE_RAD)


def _good_stamps(original: Recording) -> set[int]:
    """Return the stamps of the frames and fixes that a pose could come from, before the fault."""
    session = original.session
    fixes = {fix.stamp_ns for fix in session.fixes}
    path = session.folder / "observable.csv"
    if not path.exists():
        return fixes | {frame.stamp_ns for frame in session.frames}
    table = read_table(path)
    seen = zip(table.texts("filename"), table.numbers("observable"), strict=True)
    names = {name for name, count in seen if count >= OBSERVABLE_EDGES}
    return fixes | {frame.stamp_ns for frame in session.frames if frame.filename in names}
