"""What a recording shows over time: series, states and decisions."""

from __future__ import annotations

import numpy as np
import rerun as rr
from scipy.stats import chi2

from maps.outcomes import Fix, Outcome
from runs.palette import ODOMETRY, REJECTED, SMOOTHED, STATES, TRACKS, TRUTH, VISION, rgb
from runs.runlog import StepRecord

#: Series by path, each with colour and legend; those of one path are logged together.
LINES = {
    "lines": (
        (TRUTH, "image lines"),
        (ODOMETRY, "map segments in the window"),
        (SMOOTHED, "matched pairs"),
    ),
    "timing": ((VISION, "extract, ms"), (SMOOTHED, "match, ms"), (ODOMETRY, "update, ms")),
    "nis/bound": ((REJECTED, "bound of the gate"),),
    **{
        f"{plot}/{name}": (style,)
        for plot in ("position", "heading")
        for name, style in (*TRACKS.items(), ("three_sigma", (TRUTH, "3 sigma of filtered")))
        if name != "vision"
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


def log_step_plots(recording: rr.RecordingStream, record: StepRecord, outcome: Outcome, gate: float) -> None:
    """Log one look's point in every plot that has one; `gate`: share of good fixes that pass it."""
    recording.log("plots/state", rr.StateChange(state=record.state))
    _log(recording, "lines", record.segments, record.selected, record.matches)
    _log(recording, "timing", record.extract_ms, record.match_ms, record.update_ms)
    if record.nis is not None and isinstance(outcome, Fix):
        dimensions = np.count_nonzero(outcome.belief.measured)
        _log(recording, "nis/innovation", record.nis)
        _log(recording, "nis/bound", float(chi2.ppf(gate, dimensions)))


def _log(recording: rr.RecordingStream, path: str, *values: float | None) -> None:
    """Log the points of a path's series; a gap in each that has none."""
    if any(value is not None for value in values):
        scalars = [np.nan if value is None else value for value in values]
        recording.log(f"plots/{path}", rr.Scalars(scalars))


def log_decision(recording: rr.RecordingStream, frame: int, record: StepRecord) -> None:
    """Log what became of one look, and why, as a line of text."""
    words = [f"{frame}", record.outcome, record.verdict, record.reason]
    if record.matches:
        words.append(f"{record.matches} matches")
    if record.nis is not None:
        words.append(f"NIS {record.nis:.1f}")
    level = rr.TextLogLevel.INFO if record.accepted else rr.TextLogLevel.WARN
    recording.log("decisions", rr.TextLog("  ".join(word for word in words if word), level=level))
