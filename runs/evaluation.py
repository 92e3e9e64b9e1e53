"""How good a run was: its results against the ground truth, which only this module opens."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from localization.window import State
from maps.outcomes import Fix
from maps.poses import Array, wrap_angle
from runs.runlog import StepRecord, Trajectory
from runs.runner import RunResult, StateSpan
from runs.session import Session
from runs.tables import read_table
from runs.tracks import headings_known, interpolate

Flags = NDArray[np.bool_]

#: A whole fix is wrong beyond these; a tracked pose is wrong beyond the other two.
WRONG_FIX_M, WRONG_FIX_RAD = 0.30, math.radians(5.0)
WRONG_POSE_M, WRONG_POSE_RAD = 0.50, math.radians(10.0)
#: A partial fix is wrong when the truth lies outside its own ellipse of this probability.
PARTIAL_PROBABILITY = 0.999
#: A frame is observable when the image supports at least so many map edges at the true pose.
OBSERVABLE_EDGES = 5


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Estimates less truth at the same stamps: `difference` (N, 3) in x, y [m], phi [rad].

    NaN where the truth is not known: outside its range of time, or without headings. `covariances`:
    (N, 3, 3) of the estimates, or None.
    """

    difference: Array
    covariances: Array | None

    @property
    def position_m(self) -> Array:
        """Distances from the truth, (N,)."""
        return np.hypot(self.difference[:, 0], self.difference[:, 1])

    @property
    def heading_rad(self) -> Array:
        """How far headings are off, not negative, (N,)."""
        return np.abs(self.difference[:, 2])

    def nees(self) -> tuple[Array, Array]:
        """Return the normalized squared error of what is measured and known, and its dimension, (N,)."""
        count = len(self.difference)
        squared, dimensions = np.full(count, np.nan), np.zeros(count)
        if self.covariances is None:
            return squared, dimensions
        measured = np.isfinite(np.diagonal(self.covariances, axis1=1, axis2=2))
        known = np.isfinite(self.difference) & measured
        position, heading = known[:, :2].all(axis=1), known[:, 2]
        for rows, size in ((position & heading, 3), (position & ~heading, 2)):
            error, sigma = self.difference[rows, :size], self.covariances[rows, :size, :size]
            weighted = np.linalg.solve(sigma, error[:, :, None])[:, :, 0]
            squared[rows], dimensions[rows] = (error * weighted).sum(axis=1), size
        return squared, dimensions

    def anees(self) -> float | None:
        """Return the mean of error squared over dimension, 1 where the covariance is honest."""
        squared, dimensions = self.nees()
        judged = np.isfinite(squared)
        return float(np.mean(squared[judged] / dimensions[judged])) if judged.any() else None

    def only(self, rows: Flags) -> Errors:
        """Return the errors of some rows."""
        return Errors(self.difference[rows], None if self.covariances is None else self.covariances[rows])


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


def errors_of(track: Trajectory, truth: Trajectory | None) -> Errors:
    """Compare a trajectory with the truth at the trajectory's stamps; without one nothing is known."""
    if truth is None:
        return Errors(np.full((len(track), 3), np.nan), track.covariances)
    difference = headings_known(track) - interpolate(track.stamps_ns, truth)
    difference[:, 2] = wrap_angle(difference[:, 2])
    return Errors(difference, track.covariances)


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
        "dropped_frames": 0,
        "vision": _vision(session, result, truth),
        "odometry": _spreads(errors_of(tracks.odometry, truth)),
        "filtered": _judged(filtered),
        "smoothed": _judged(errors_of(tracks.smoothed, truth)),
        "states": states,
        "availability": 1.0 - states[State.LOST.value] / total if total else None,
        "tracking_wrong_s": _tracking_wrong_s(result.spans, tracks.filtered, filtered) if truth else None,
        "timing_ms": _timing(result),
    }


def _judged(errors: Errors) -> dict[str, Any]:
    return {**_spreads(errors), "anees": errors.anees()}


def _vision(session: Session, result: RunResult, truth: Trajectory | None) -> dict[str, Any]:
    records = result.records
    outcomes = Counter(record.outcome for record in records)
    fixes = [
        (record, outcome.belief)
        for record, outcome in zip(records, result.outcomes, strict=True)
        if isinstance(outcome, Fix)
    ]
    errors = errors_of(Trajectory.of_beliefs([belief for _, belief in fixes]), truth)
    whole = np.array([record.outcome == "FIX" for record, _ in fixes], bool)
    accepted = np.array([record.verdict == "FUSED" for record, _ in fixes], bool)
    wrong = _wrong(errors, whole)
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


def _wrong(errors: Errors, whole: Flags) -> Flags:
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


def _tracking_wrong_s(spans: Sequence[StateSpan], filtered: Trajectory, errors: Errors) -> float:
    """Return the longest time on end in TRACKING with the published pose wrong."""
    far = (errors.position_m > WRONG_POSE_M) | (errors.heading_rad > WRONG_POSE_RAD)
    wrong_ns = set(filtered.stamps_ns[far].tolist())
    longest = lasting = 0
    for span in spans:
        wrong = span.state is State.TRACKING and span.stamp_ns in wrong_ns
        lasting = lasting + span.stamp_ns - span.start_ns if wrong else 0
        longest = max(longest, lasting)
    return longest / 1e9


def _timing(result: RunResult) -> dict[str, Any]:
    records: tuple[StepRecord, ...] = result.records
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
    spread = _spread(np.array(list(values)))
    return {"median": spread["median"], "p95": spread["p95"]}


def _spreads(errors: Errors) -> dict[str, Any]:
    return {
        "position_error_m": _spread(errors.position_m),
        "heading_error_deg": _spread(np.degrees(errors.heading_rad)),
    }


def _spread(values: Array) -> dict[str, float | None]:
    """Return median, 95th percentile, maximum and root mean square of what is known."""
    known = values[np.isfinite(values)]
    if not len(known):
        return {"median": None, "p95": None, "max": None, "rmse": None}
    return {
        "median": float(np.median(known)),
        "p95": float(np.percentile(known, 95)),
        "max": float(known.max()),
        "rmse": float(np.sqrt(np.mean(known**2))),
    }
