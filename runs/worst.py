"""The frames of a run that went worst, each with its picture and what went wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from localization.ekf import quantile
from maps.errors import InputError
from maps.outcomes import Ambiguous, Fix, NoFix
from runs.evaluation import wrong_fixes
from runs.runlog import StepRecord, Trajectory
from runs.runner import RunResult
from runs.session import Session
from runs.tracks import errors_of
from vision.overlay import matched_jpeg

#: How many a report shows.
WORST = 5

#: The probability of a truth this far out in a fix's own covariance, beyond which the fix is worth a look.
FAR_OUT = 0.99

#: What lies behind a reason, in a few words; docs/troubleshooting.md says what to do.
BEHIND = {
    "UNREADABLE_IMAGE": "the file is no image",
    "TOO_FEW_SEGMENTS": "hardly any lines: dark, blurred, covered, or a bare wall",
    "NOTHING_VISIBLE": "the map has too few edges that can be seen from here",
    "NO_HYPOTHESIS": "no pose in the search window fits",
    "WEAK_EVIDENCE": "the best pose is no better than chance would make one",
    "WEAK_GEOMETRY": "what was matched leaves the pose open",
    "AMBIGUOUS": "several places look like this",
    "HEADING_UNKNOWN": "positions alone, and the heading is not known yet",
    "UNCONFIRMED": "a place was found while lost, and no other look has confirmed it",
    "GATE": "too far from what the filter expected",
    "TOO_OLD": "the image came too late",
    "TOO_NEW": "the image is from ahead of the odometry",
}


@dataclass(frozen=True, slots=True)
class WorstFrame:
    """One of them: its stamp, file, what went wrong in a line, and a JPEG of what was matched in it."""

    stamp_ns: int
    filename: str
    wrong: str
    jpeg: bytes


def worst_frames(session: Session, result: RunResult, truth: Trajectory | None) -> list[WorstFrame]:
    """Return the worst frames of a run, worst first; fewer where there are not so many.

    Fixes that are wrong come first, those that were fused before those that were not; then refused ones, frames
    without a fix, by how much there was to see, and fixes that are far off, in their own measure.
    """
    frames = {frame.filename: frame for frame in session.frames}
    if not frames:
        return []
    judged = [
        (*badness, number)
        for number, (record, badness) in enumerate(_judged(result, truth))
        if record.filename in frames
    ]
    judged.sort(key=lambda frame: frame[:2], reverse=True)
    found: list[WorstFrame] = []
    for _, _, wrong, number in judged:
        if len(found) == WORST:
            break
        record = result.records[number]
        try:
            jpeg = matched_jpeg(frames[record.filename].image(), result.outcomes[number].look)
        except InputError:
            continue
        found.append(WorstFrame(record.stamp_ns, record.filename, wrong, jpeg))
    return found


def _judged(
    result: RunResult, truth: Trajectory | None
) -> Iterator[tuple[StepRecord, tuple[int, float, str]]]:
    """Yield every look with how bad it is: its class, its place in the class, and why."""
    fixes = [outcome.belief for outcome in result.outcomes if isinstance(outcome, Fix)]
    errors = errors_of(Trajectory.of_beliefs(fixes), truth)
    whole = np.array([outcome.outcome == "FIX" for outcome in result.records if _has_fix(outcome)], bool)
    wrong = wrong_fixes(errors, whole)
    squared, dimensions = errors.nees()
    numbers = iter(range(len(fixes)))
    for record, outcome in zip(result.records, result.outcomes, strict=True):
        if not isinstance(outcome, Fix):
            yield record, _without(record, outcome)
            continue
        number = next(numbers)
        off_m, off_deg = float(errors.position_m[number]), float(np.degrees(errors.heading_rad[number]))
        off = f"{off_m:.2f} m and {off_deg:.1f}° off"
        # Told apart by their own covariance, so that a fix of a corridor is not blamed for what it leaves open.
        out = squared[number] > quantile(FAR_OUT, max(int(dimensions[number]), 1))
        if wrong[number]:
            fused = "wrong, and fused" if record.accepted else "wrong, and refused"
            yield record, (5 if record.accepted else 4, off_m, f"{fused}: {off}")
        elif not record.accepted:
            reason = f"{record.reason}, {BEHIND.get(record.reason, 'not fused')}"
            nis = 0.0 if record.nis is None else record.nis
            right = f"; it was {off}" if np.isfinite(off_m) else ""
            yield record, (3, nis, f"not used: {reason} (NIS {nis:.1f}){right}")
        elif out:
            yield record, (1, float(squared[number]), f"fused, and {off}: more than its covariance says")
        else:
            size = float(np.nan_to_num(squared[number])) if truth else record.nis or 0.0
            told = off if np.isfinite(off_m) else f"NIS {size:.1f}"
            yield record, (0, size, f"fused: {told}")


def _without(record: StepRecord, outcome: Ambiguous | NoFix) -> tuple[int, float, str]:
    behind = BEHIND.get(record.reason, "")
    if isinstance(outcome, Ambiguous):
        told = f"ambiguous: {behind or BEHIND['AMBIGUOUS']}"
    else:
        told = f"no fix: {record.reason}, {behind}" if behind else f"no fix: {record.reason}"
    return 2, float(len(outcome.look.lines_px)), told


def _has_fix(record: StepRecord) -> bool:
    return record.outcome in ("FIX", "PARTIAL")
