"""What a recording shows over time: series, states and decisions."""

from __future__ import annotations

import numpy as np
import rerun as rr

from localization.ekf import quantile
from maps.outcomes import Ambiguous, Fix, NoFix, Outcome
from runs.palette import ODOMETRY, REJECTED, SMOOTHED, STATES, TRACKS, TRUTH, VISION, rgb
from runs.rowbatch import RowBatch
from runs.runlog import StepRecord

#: Series by path, each with colour and legend; those of one path are logged together.
LINES = {
    "lines": (
        (TRUTH, "image lines"),
        (ODOMETRY, "map segments in the window"),
        (SMOOTHED, "matched pairs"),
    ),
    "hypotheses": (
        (ODOMETRY, "map segments in the window"),
        (TRUTH, "poses scored"),
        (VISION, "poses refined"),
        (SMOOTHED, "places left"),
    ),
    "timing": ((VISION, "extract, ms"), (SMOOTHED, "match, ms"), (ODOMETRY, "update, ms")),
    "nis/bound": ((REJECTED, "bound of the gate"),),
    "drift/position/odometry": (TRACKS["odometry"],),
    "drift/heading/odometry": (TRACKS["odometry"],),
    **{
        f"{plot}/{name}": (style,)
        for plot in ("position", "heading")
        for name, style in (*TRACKS.items(), ("three_sigma", (TRUTH, "3 sigma of filtered")))
        if name not in ("vision", "odometry")
    },
}

#: Series of single looks, shown as points.
POINTS = {
    "nis/innovation": (VISION, "innovation (NIS)"),
    "position/vision": TRACKS["vision"],
    "heading/vision": TRACKS["vision"],
}


def style_plots(recording: rr.RecordingStream) -> None:
    """Name and colour every series, once."""
    for path, series in LINES.items():
        colours, names = [rgb(colour) for colour, _ in series], [name for _, name in series]
        lines = rr.SeriesLines(colors=colours, names=names, widths=[1.5] * len(series))
        recording.log(f"plots/{path}", lines, static=True)
    for path, (colour, name) in POINTS.items():
        points = rr.SeriesPoints(colors=rgb(colour), names=name, marker_sizes=3.0)
        recording.log(f"plots/{path}", points, static=True)
    states = rr.StateConfiguration(values=list(STATES), colors=[rgb(colour) for colour in STATES.values()])
    recording.log("plots/state", states, static=True)


def log_step_plots(batch: RowBatch, record: StepRecord, outcome: Outcome, gate: float) -> None:
    """Log one look's point in every plot that has one; `gate`: share of good fixes that pass it."""
    batch.add("plots/state", rr.StateChange, state=[record.state])
    _log(batch, "lines", record.segments, record.selected, record.matches)
    if record.hypotheses is not None:
        kept = record.selected, record.hypotheses, outcome.look.refined, _places(outcome)
        _log(batch, "hypotheses", *kept)
    _log(batch, "timing", record.extract_ms, record.match_ms, record.update_ms)
    if record.nis is not None and isinstance(outcome, Fix):
        dimensions = int(np.count_nonzero(outcome.belief.measured))
        _log(batch, "nis/innovation", record.nis)
        _log(batch, "nis/bound", quantile(gate, dimensions))


def _log(batch: RowBatch, path: str, *values: float | None) -> None:
    """Log the points of a path's series; a gap in each that has none."""
    if any(value is not None for value in values):
        scalars = [np.nan if value is None else value for value in values]
        batch.add(f"plots/{path}", rr.Scalars, scalars=scalars)


def log_decision(batch: RowBatch, frame: int, record: StepRecord, before: str) -> None:
    """Log what became of one look, and why, as a line of text; and the state, where it is not as `before`."""
    words = [f"{frame}", record.outcome, record.verdict, record.reason]
    if record.matches:
        words.append(f"{record.matches} matches")
    if record.nis is not None:
        words.append(f"NIS {record.nis:.1f}")
    _say(batch, "decisions", "  ".join(word for word in words if word), good=record.accepted)
    if record.state != before:
        change = f"{frame}  {before} -> {record.state}" if before else f"{frame}  begins {record.state}"
        _say(batch, "decisions/state", change, good=record.state == "TRACKING")


def _say(batch: RowBatch, entity: str, text: str, *, good: bool) -> None:
    level = rr.TextLogLevel.INFO if good else rr.TextLogLevel.WARN
    batch.add(entity, rr.TextLog, text=[text], level=[level])


def _places(outcome: Outcome) -> int:
    """How many places an image is left with."""
    match outcome:
        case Fix():
            return 1
        case Ambiguous():
            return len(outcome.beliefs)
        case NoFix():
            return 0
