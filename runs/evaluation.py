"""How good a run was: its results against the ground truth, which only this module opens."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from localization.states import State
from maps.outcomes import Fix
from runs.diary import StateSpan
from runs.runlog import StepRecord, Trajectory
from runs.runner import RunResult
from runs.session import Session
from runs.tables import read_table
from runs.tracks import Errors, Flags, errors_of, spread

#: A whole fix is wrong beyond these; a tracked pose is wrong beyond the other two.
WRONG_FIX_M, WRONG_FIX_RAD = 0.30, math.radians(5.0)
WRONG_POSE_M, WRONG_POSE_RAD = 0.50, math.radians(10.0)
#: A partial fix is wrong when the truth lies outside its own ellipse of this probability.
PARTIAL_PROBABILITY = 0.999
#: A frame is observable when the image supports at least so many map edges at the true pose.
OBSERVABLE_EDGES = 5


def read_truth(folder: Path) -> Trajectory | None:
    """Read a session's ground truth, the dense one where there is one; None where there is none.

    Headings are NaN where the file leaves them empty.
    """
    paths = (folder / "ground_truth_dense.csv", folder / "ground_truth.csv")
    path = next((path for path in paths if path.exists()), None)
    if path is None:
        return None
    table = read_table(path)
    phi = table.numbers("phi_rad", may_be_empty=True)
    poses = np.column_stack([table.numbers("x_m"), table.numbers("y_m"), phi])
    return Trajectory(table.times(may_repeat=True), poses)


def evaluate(session: Session, result: RunResult, truth: Trajectory | None) -> dict[str, Any]:
    """Return metrics.json's content; every key is there, None without truth."""
    tracks = result.trajectories
    filtered = errors_of(tracks.filtered, truth)
    states = {state.value: 0.0 for state in State}
    for span in result.spans:
        states[span.state.value] += (span.stamp_ns - span.start_ns) / 1e9
    total = sum(states.values())
    return {
        "session": session.name,
        "frames": len(session.frames),
        "dropped_frames": result.dropped,
        "vision": _vision(session, result, truth),
        "odometry": _spreads(errors_of(tracks.odometry, truth)),
        "filtered": _judged(filtered),
        "smoothed": _judged(errors_of(tracks.smoothed, truth)),
        "fixed_lag": _judged(errors_of(tracks.fixed_lag, truth)) if len(tracks.fixed_lag) else None,
        "second_pass": _second_pass(result, truth),
        "states": states,
        "availability": 1.0 - states[State.LOST.value] / total if total else None,
        "tracking_wrong_s": (
            tracking_wrong_s(result.spans, wrong_stamps(tracks.filtered, filtered)) if truth else None
        ),
        "timing_ms": _timing(result),
    }


def _judged(errors: Errors) -> dict[str, Any]:
    return {**_spreads(errors), "anees": errors.anees()}


def _vision(session: Session, result: RunResult, truth: Trajectory | None) -> dict[str, Any]:
    records = tuple(result.records)
    outcomes = Counter(record.outcome for record in records)
    fixes = [
        (record, outcome.belief)
        for record, outcome in zip(records, result.outcomes, strict=True)
        if isinstance(outcome, Fix)
    ]
    errors = errors_of(Trajectory.of_beliefs([belief for _, belief in fixes]), truth)
    whole = np.array([record.outcome == "FIX" for record, _ in fixes], bool)
    accepted = np.array([record.accepted for record, _ in fixes], bool)
    wrong = wrong_fixes(errors, whole)
    observable = _observable(session)
    return {
        "attempted": len(records),
        "fixes": outcomes["FIX"],
        "partial": outcomes["PARTIAL"],
        "ambiguous": outcomes["AMBIGUOUS"],
        "no_fix": dict(sorted(Counter(r.reason for r in records if r.outcome == "NO_FIX").items())),
        "accepted": int(accepted.sum()),
        "rejected": sum(record.verdict == "REJECTED" for record in records),
        "wrong": int(wrong.sum()) if truth else None,
        "wrong_accepted": int((wrong & accepted).sum()) if truth else None,
        "observable_frames": None if observable is None else len(observable),
        "fixes_in_observable": None
        if observable is None
        else sum(record.outcome == "FIX" and record.filename in observable for record in records),
        **_spreads(errors.only(whole)),
        "anees": errors.only(whole & ~wrong).anees(),
        "anees_all": errors.only(whole).anees(),
    }


def _second_pass(result: RunResult, truth: Trajectory | None) -> dict[str, Any]:
    """Return what looking again brought, which only the smoothed trajectory knows of."""
    fixes = result.again.fixes
    errors = errors_of(Trajectory.of_beliefs([fix.belief for fix in fixes]), truth)
    whole = np.array([not fix.partial for fix in fixes], bool)
    return {
        "attempted": result.again.tried,
        "fixes": int(whole.sum()),
        "partial": int((~whole).sum()),
        "wrong": int(wrong_fixes(errors, whole).sum()) if truth else None,
    }


def wrong_fixes(errors: Errors, whole: Flags) -> Flags:
    """Return which fixes are wrong, (N,) bool; where the truth is not known none is."""
    far = (errors.position_m > WRONG_FIX_M) | (errors.heading_rad > WRONG_FIX_RAD)
    squared, dimensions = errors.nees()
    outside = squared > chi2.ppf(PARTIAL_PROBABILITY, np.maximum(dimensions, 1))
    return np.where(whole, far, outside)


def _observable(session: Session) -> set[str] | None:
    """Return the session's frames that a matcher could be asked to fix; None where nobody says."""
    path = session.folder / "observable.csv"
    if not path.exists():
        return None
    table = read_table(path)
    edges = zip(table.texts("filename"), table.numbers("observable"), strict=True)
    seen = {filename for filename, count in edges if count >= OBSERVABLE_EDGES}
    return seen & {frame.filename for frame in session.frames}


def tracking_wrong_s(spans: Iterable[StateSpan], wrong_ns: set[int]) -> float:
    """Return the longest time on end in TRACKING with the published pose wrong: at these stamps."""
    longest = lasting = 0
    for span in spans:
        wrong = span.state is State.TRACKING and span.stamp_ns in wrong_ns
        lasting = lasting + span.stamp_ns - span.start_ns if wrong else 0
        longest = max(longest, lasting)
    return longest / 1e9


def wrong_stamps(track: Trajectory, errors: Errors) -> set[int]:
    """Return the stamps [ns] at which a track's pose is wrong, by its errors."""
    far = (errors.position_m > WRONG_POSE_M) | (errors.heading_rad > WRONG_POSE_RAD)
    return set(track.stamps_ns[far].tolist())


def _timing(result: RunResult) -> dict[str, Any]:
    records: Sequence[StepRecord] = tuple(result.records)
    looks = [
        (r.extract_ms, r.match_ms) for r in records if r.extract_ms is not None and r.match_ms is not None
    ]
    return {
        "extract": _typical(extract for extract, _ in looks),
        "match": _typical(match for _, match in looks),
        "fix": _typical(extract + match for extract, match in looks),
        "predict": _typical(result.predict_ms),
        "update": _typical(record.update_ms for record in records),
    }


def _typical(values: Iterable[float]) -> dict[str, float | None]:
    found = spread(np.fromiter(values, np.float64))
    return {"median": found.median, "p95": found.p95}


def _spreads(errors: Errors) -> dict[str, Any]:
    return {
        "position_error_m": asdict(spread(errors.position_m)),
        "heading_error_deg": asdict(spread(np.degrees(errors.heading_rad))),
    }
