"""What a fault did to a run: how long it was wrong unawares, how soon it was right again, when it gave up."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from localization.states import State
from maps.poses import Array, Pose2
from runs.diary import StateSpan
from runs.evaluation import (
    OBSERVABLE_EDGES,
    WRONG_FIX_M,
    WRONG_FIX_RAD,
    WRONG_POSE_M,
    WRONG_POSE_RAD,
    wrong_stamps,
)
from runs.faults.recording import Recording, Span
from runs.runlog import StepRecord, Trajectory
from runs.runner import RunResult
from runs.session import Session
from runs.simulation.observable import observed
from runs.tables import read_table
from runs.tracks import errors_of, interpolate
from vision.images import GreyImage
from vision.projection import Projector

#: So many observable frames may pass after a pose has become wrong; then nothing excuses that it is called right.
SETTLED = 3
#: A robot is back where its pose would pass for a right fix. At half a metre it may still have all of a slip in it.
BACK = WRONG_FIX_M, WRONG_FIX_RAD


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a fault did.

    `wrong_s`: longest time on end in TRACKING while the pose is wrong, and has been so for three observable frames.
    `wrong_looks`: most observable frames on end after each of which the state is TRACKING and the pose wrong.
    `recovered_after`: observable frames from the fault's end on until the state is TRACKING and the pose no farther
    off than a right fix may be, and still so near after the next frame; None where that never came or there was no
    end. `looks_after`: how many such frames there were, right or not; without one there was nothing to be right in.
    `lost_after`: frames until the first LOST, None for never. Without a truth only that is known. `astray`: how many
    of these came after the last fix accepted that was right: another building's map may be right for a part of a way.
    """

    wrong_s: float | None
    wrong_looks: int | None
    recovered_after: int | None
    looks_after: int | None
    lost_after: int | None
    astray: int | None


def judged(
    faulty: Recording, span: Span, result: RunResult, truth: Trajectory | None, obscured: bool = False
) -> Judgement:
    """Judge the run of a recording that a fault was done to.

    Frames count where they are observable as the session's observable.csv says, all where there is none.
    `obscured`: less can be seen in the pictures that the fault has changed, and edges are counted there anew.
    """
    until_lost = _until_lost(result)
    lost_after = None if until_lost is None else len(until_lost)
    if truth is None:
        return Judgement(None, None, None, None, lost_after, None)
    good = _good_stamps(faulty)
    if obscured:
        good -= _obscured_stamps(faulty, truth)
    looks = sorted(record.arrival_ns for record in result.records if record.stamp_ns in good)
    filtered = result.trajectories.filtered
    wrong_s = wrong_unawares_s(result.spans, wrong_stamps(filtered, errors_of(filtered, truth)), looks)
    after = [] if span.end_ns >= faulty.span.end_ns else _looks_since(span.end_ns, result, good)
    wrong_looks, recovered = _wrong_looks(result, good, truth), _recovered(after, truth)
    astray = None if until_lost is None else _since_right(until_lost, truth)
    return Judgement(wrong_s, wrong_looks, recovered, len(after), lost_after, astray)


def judged_undisturbed(session: Session, result: RunResult, truth: Trajectory | None) -> Judgement:
    """Judge the run of a session that nothing was done to."""
    untouched = Recording(session, (None,) * len(session.frames), None)
    end_ns = untouched.span.end_ns
    return judged(untouched, Span(end_ns, end_ns), result, truth)


def wrong_unawares_s(spans: Iterable[StateSpan], wrong_ns: set[int], looks_ns: Sequence[int]) -> float:
    """Return the longest time on end in TRACKING with a pose that has been wrong for three observable frames.

    `wrong_ns`: stamps at which the published pose is wrong, whatever the state. `looks_ns`: when observable frames
    arrived, in order. No robot knows of a fault before its next image, and one image may be mistaken; a robot that
    has had three since its pose went wrong has none of these excuses. What a third image brings is published with
    the first step that ends after it.
    """
    longest = lasting = 0
    since_ns: int | None = None
    for span in spans:
        if span.stamp_ns not in wrong_ns:
            since_ns, lasting = None, 0
            continue
        since_ns = span.stamp_ns if since_ns is None else since_ns
        seen = np.searchsorted(looks_ns, [since_ns, span.stamp_ns])
        unawares = span.state is State.TRACKING and seen[1] - seen[0] >= SETTLED
        lasting = lasting + span.stamp_ns - span.start_ns if unawares else 0
        longest = max(longest, lasting)
    return longest / 1e9


def _wrong_looks(result: RunResult, good: set[int], truth: Trajectory) -> int:
    longest = lasting = 0
    for record in result.records:
        if record.x_m is None:
            # Older than the filter remembers, or ahead of odometry: nothing was said of that moment.
            continue
        if record.state != State.TRACKING.value or _near(record, truth, WRONG_POSE_M, WRONG_POSE_RAD):
            lasting = 0
        elif record.stamp_ns in good:
            lasting += 1
            longest = max(longest, lasting)
    return longest


def _until_lost(result: RunResult) -> list[StepRecord] | None:
    """Return the records up to the first one that leaves the robot LOST, that one included; None for never."""
    until = list[StepRecord]()
    for record in result.records:
        until.append(record)
        if record.state == State.LOST.value:
            return until
    return None


def _since_right(records: Sequence[StepRecord], truth: Trajectory) -> int:
    """Return how many records come after the last right fix that was accepted."""
    for since, record in enumerate(reversed(records)):
        fix = record.fix_x_m, record.fix_y_m, record.fix_phi_rad
        if record.accepted and _at(record.stamp_ns, fix, truth, *BACK):
            return since
    return len(records)


def _looks_since(stamp_ns: int, result: RunResult, good: set[int]) -> list[StepRecord]:
    return [record for record in result.records if record.stamp_ns >= stamp_ns and record.stamp_ns in good]


def _recovered(after: Sequence[StepRecord], truth: Trajectory) -> int | None:
    for at, record in enumerate(after, start=1):
        # A pose that the next frame finds wrong again was not right, it only came by.
        stays = at == len(after) or after[at].x_m is None or _near(after[at], truth, *BACK)
        if record.state == State.TRACKING.value and _near(record, truth, *BACK) and stays:
            return at
    return None


def _near(record: StepRecord, truth: Trajectory, limit_m: float, limit_rad: float) -> bool:
    """Tell whether the pose after a frame is within limits of the truth."""
    return _at(record.stamp_ns, (record.x_m, record.y_m, record.phi_rad), truth, limit_m, limit_rad)


def _at(
    stamp_ns: int, pose: tuple[float | None, ...], truth: Trajectory, limit_m: float, limit_rad: float
) -> bool:
    """Tell whether a pose (x, y, phi), if it is known, is within limits of the truth."""
    x_m, y_m, phi_rad = pose
    if x_m is None or y_m is None or phi_rad is None:
        return False
    x, y, phi = interpolate(np.array([stamp_ns]), truth)[0]
    far = math.hypot(x_m - x, y_m - y)
    turned = abs(math.remainder(phi_rad - phi, math.tau))
    return not (far > limit_m or turned > limit_rad)


def _good_stamps(faulty: Recording) -> set[int]:
    """Return the stamps, as the fault left them, of the frames and fixes that a pose could come from."""
    session = faulty.session
    fixes = {fix.stamp_ns for fix in session.fixes}
    path = session.folder / "observable.csv"
    if not path.exists():
        return fixes | {frame.stamp_ns for frame in session.frames}
    table = read_table(path)
    seen = zip(table.texts("filename"), table.numbers("observable"), strict=True)
    names = {name for name, count in seen if count >= OBSERVABLE_EDGES}
    return fixes | {frame.stamp_ns for frame in session.frames if frame.filename in names}


def _obscured_stamps(faulty: Recording, truth: Trajectory) -> set[int]:
    """Return the stamps of changed pictures that show fewer edges than an observable frame does."""
    session = faulty.session
    if session.camera is None or session.wire_map is None:
        return set()
    projector, stamps = Projector(session.camera, session.wire_map), set()
    changed = [(frame, edit) for frame, edit in zip(session.frames, faulty.edits, strict=True) if edit]
    poses = interpolate(np.array([frame.stamp_ns for frame, _ in changed], np.int64), truth)
    for (frame, edit), pose in zip(changed, poses, strict=True):
        known = bool(np.isfinite(pose).all())
        if not known or _edges(edit(frame.image()), projector, pose) < OBSERVABLE_EDGES:
            stamps.add(frame.stamp_ns)
    return stamps


def _edges(image: GreyImage, projector: Projector, pose: Array) -> int:
    return observed(image, projector, Pose2.from_array(pose)).observable
