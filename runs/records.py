"""From what happened at a frame or recorded fix to its row of steps.csv."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from localization.states import State
from localization.verdicts import ACCEPTED, Fused, Missed, Rejected, Relocalized, Verdict
from maps.outcomes import Ambiguous, Fix, Look, NoFix, Outcome, PoseBelief, SearchWindow
from runs.runlog import StepRecord
from runs.session import Frame, RecordedFix

Cell = float | None
Six = tuple[Cell, Cell, Cell, Cell, Cell, Cell]

_UPPER = np.triu_indices(3)


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """One look at the world on its way through the localizer.

    `window`: where the matcher searched, None for a recorded fix. `prior`, `posterior`: the beliefs at
    its stamp before and after, None while lost. `look_ms`: what the matcher spent, by stage.
    """

    event: Frame | RecordedFix
    window: SearchWindow | None
    outcome: Outcome
    look_ms: Mapping[str, float]
    prior: PoseBelief | None
    verdict: Verdict
    update_ms: float
    posterior: PoseBelief | None
    state: State

    def record(self) -> StepRecord:
        """Return the row that tells it."""
        event, prior, window = self.event, self.prior, self.window
        look = self.outcome.look if isinstance(event, Frame) else None
        fix = self.outcome.belief if isinstance(self.outcome, Fix) else None
        verdict, nis = _verdict(self.verdict)
        return StepRecord(
            event.stamp_ns,
            event.arrival_ns,
            event.filename if isinstance(event, Frame) else "",
            self.state.value,
            *_pose(prior),
            window.dt_m if window else None,
            window.dphi_rad if window else None,
            *_counts(look),
            outcome_name(self.outcome),
            _reason(self.outcome, self.verdict),
            *_pose(fix),
            *_covariance(fix),
            verdict,
            nis,
            *_pose(self.posterior),
            *_covariance(self.posterior),
            self.look_ms.get("extract"),
            self.look_ms.get("match"),
            self.update_ms,
        )


def outcome_name(outcome: Outcome) -> str:
    """Return the word for an outcome in steps.csv: FIX, PARTIAL, AMBIGUOUS or NO_FIX."""
    match outcome:
        case Fix():
            return "PARTIAL" if outcome.partial else "FIX"
        case Ambiguous():
            return "AMBIGUOUS"
        case NoFix():
            return "NO_FIX"


def _verdict(verdict: Verdict) -> tuple[str, Cell]:
    match verdict:
        case Fused():
            return "FUSED", verdict.nis
        case Relocalized():
            return "RELOCALIZED", verdict.nis
        case Rejected():
            return "REJECTED", verdict.nis
        case Missed():
            return "MISSED", None


def _reason(outcome: Outcome, verdict: Verdict) -> str:
    if isinstance(outcome, NoFix):
        return outcome.reason.value
    return "" if isinstance(verdict, ACCEPTED) else str(verdict.reason)


def _counts(look: Look | None) -> tuple[int | None, int | None, int | None, int | None]:
    if look is None:
        return None, None, None, None
    return len(look.lines_px), look.selected, look.hypotheses, len(look.matched_map)


def _pose(belief: PoseBelief | None) -> tuple[Cell, Cell, Cell]:
    if belief is None:
        return None, None, None
    return belief.pose.x, belief.pose.y, belief.pose.phi if belief.measured[2] else None


def _covariance(belief: PoseBelief | None) -> Six:
    """Return xx, xy, xp, yy, yp, pp, with None for what was not measured."""
    if belief is None:
        return None, None, None, None, None, None
    measured, sigma = belief.measured, belief.covariance
    known = np.where(np.outer(measured, measured), sigma, np.nan)
    xx, xy, xp, yy, yp, pp = (None if np.isnan(value) else float(value) for value in known[_UPPER])
    return xx, xy, xp, yy, yp, pp
