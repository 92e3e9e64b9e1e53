"""Figures of runs: the plan, errors over time, cumulative errors; for reports and papers.

All ink is one colour, so that a page can give an inline SVG the colour of its own text.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO, StringIO
from itertools import cycle
from typing import Any, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from maps.poses import Array
from runs.folder import RunFolder, Step, fix_covariance
from runs.palette import REJECTED, TRACKS, TRUTH, VISION
from runs.runlog import ACCEPTED
from runs.shapes import ellipse, floor_rings
from runs.tracks import Errors, errors_of

#: Narrow enough for a phone, where a wider figure's text would shrink beyond reading.
WIDTH_IN = 5.0

POSITION, HEADING = "position, m", "heading, deg"

#: Errors span decades, from what a filter reaches to where dead reckoning ends.
SCALES = {POSITION: (1e-3, 1e1), HEADING: (1e-2, 1e2)}

#: A line of more points than this would be a band: errors swing through zero all the time.
SPANS = 300

#: More ellipses than this would hide each other, more points would make a page too large to open: of a long drive
#: some are shown.
ELLIPSES, POINTS = 1000, 50_000

Rows = TypeVar("Rows", Sequence[Step], Array)

INK = "#1f2328"
STYLE: Any = {
    "font.size": 10.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": "none",
    "grid.color": INK,
    "grid.alpha": 0.15,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "wireloc",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


@matplotlib.rc_context(STYLE)
def plan(runs: Sequence[RunFolder]) -> Figure:
    """Draw each run's floor, trajectories and fixes, one above the other."""
    corners = [_extent(run) for run in runs]
    heights = [float(np.clip(0.9 * WIDTH_IN * depth / width, 2.0, 8.0)) for width, depth in corners]
    figure = blank_figure(sum(heights) + 1.1)
    panels = figure.subplots(len(runs), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, run in zip(panels, runs, strict=True):
        _draw_plan(axes, run)
        if len(runs) > 1:
            axes.set_title(run.name, fontsize=10.0)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@matplotlib.rc_context(STYLE)
def errors_over_time(run: RunFolder) -> Figure:
    """Draw each trajectory's largest errors in short spans of time, and every fix's, on scales of decades."""
    figure = blank_figure(5.6)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (quantity, (smallest, largest)) in zip(panels, SCALES.items(), strict=True):
        for name, (seconds, found) in _all_errors(run).items():
            colour, label = TRACKS[name]
            values = _values(found, quantity)
            style: Any = {"linestyle": "none", "marker": "."}
            if name != "vision":
                seconds, values = _crests(seconds, values)
                style = {"linewidth": 1.2}
            axes.plot(seconds, np.clip(values, smallest, largest), color=colour, label=label, **style)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_ylim(smallest, largest)
        axes.minorticks_off()
        axes.set_ylabel(quantity)
        axes.grid(visible=True)
    panels[1].set_xlabel("time, s")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


@matplotlib.rc_context(STYLE)
def cumulative(runs: Sequence[RunFolder]) -> Figure:
    """Draw which share of each trajectory's poses is better than an error; dashes tell runs apart."""
    figure = blank_figure(3.4)
    panels = figure.subplots(1, 2, sharey=True)
    for run, dashes in zip(runs, cycle(("-", "--", ":", "-.")), strict=False):
        for name, (_, found) in _all_errors(run).items():
            colour, label = TRACKS[name]
            for axes, quantity in zip(panels, SCALES, strict=True):
                values = _values(found, quantity)
                values = np.sort(values[np.isfinite(values)])
                shares = 100.0 * np.arange(1, len(values) + 1) / max(len(values), 1)
                title = label if len(runs) == 1 else f"{label}, {run.name}"
                axes.plot(values, shares, dashes, color=colour, label=title)
                axes.set_xlabel(quantity)
    for axes, limits in zip(panels, SCALES.values(), strict=True):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(limits)
        axes.minorticks_off()
        axes.set_ylim(0.0, 100.0)
        axes.grid(visible=True)
    panels[0].set_ylabel("share of poses, %")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def svg(figure: Figure) -> str:
    """Return a figure as an SVG element whose ink is the surrounding text's colour."""
    text = StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(text, format="svg", metadata={"Date": None})
    element = text.getvalue()
    return element[element.index("<svg") :].replace(INK, "currentColor")


def png(figure: Figure, dots_per_inch: int = 200) -> bytes:
    """Return a figure as a PNG image on white."""
    image = BytesIO()
    figure.savefig(image, format="png", dpi=dots_per_inch, facecolor="white")
    return image.getvalue()


def blank_figure(height_in: float) -> Figure:
    """Return an empty figure of the usual width."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _all_errors(run: RunFolder) -> dict[str, tuple[Array, Errors]]:
    """Times and errors of whole fixes and of each trajectory; a reference is not compared with itself."""
    tracks = run.tracks | {"vision": run.whole_fixes}
    return {
        name: (track.stamps_ns / 1e9, errors_of(track, run.reference))
        for name, track in tracks.items()
        if track is not run.reference
    }


def _values(found: Errors, quantity: str) -> Array:
    return found.position_m if quantity == POSITION else np.degrees(found.heading_rad)


def _crests(seconds: Array, values: Array) -> tuple[Array, Array]:
    """Return the largest value in each of at most `SPANS` spans of time, where it begins."""
    if not len(seconds):
        return seconds, values
    spans = np.floor((seconds - seconds[0]) / max(seconds[-1] - seconds[0], 1e-9) * SPANS)
    starts = np.flatnonzero(np.diff(spans, prepend=-1.0))
    return seconds[starts], np.maximum.reduceat(values, starts)


def _extent(run: RunFolder) -> tuple[float, float]:
    """Width and depth of what a plan shows, metres."""
    if run.wire_map is not None:
        x0, y0, x1, y1 = run.wire_map.floor.bounds
        return x1 - x0, y1 - y0
    points = np.vstack([track.poses[:, :2] for track in run.tracks.values()])
    width, depth = np.ptp(points, axis=0) if len(points) else (1.0, 1.0)
    return max(float(width), 1.0), max(float(depth), 1.0)


def _draw_plan(axes: Axes, run: RunFolder) -> None:
    if run.wire_map is not None:
        axes.add_collection(LineCollection(floor_rings(run.wire_map.floor), colors=INK, linewidths=0.8))
        x0, y0, x1, y1 = run.wire_map.floor.bounds
        axes.set_xlim(x0 - 0.3, x1 + 0.3)
        axes.set_ylim(y0 - 0.3, y1 + 0.3)
    if run.truth is not None:
        axes.plot(
            *_some(run.truth.poses, POINTS)[:, :2].T, color=TRUTH, linewidth=3.0, alpha=0.6, label="truth"
        )
    for name in ("odometry", "filtered", "smoothed"):
        colour, label = TRACKS[name]
        poses = _some(run.tracks[name].poses, POINTS)
        axes.plot(*poses[:, :2].T, color=colour, linewidth=1.2, label=label)
    looks = [step for step in run.steps if step["fix_x_m"]]
    for label, colour, taken in (("fix, accepted", VISION, True), ("fix, rejected", REJECTED, False)):
        steps = [step for step in looks if (step["verdict"] in ACCEPTED) == taken]
        centres = np.array([_centre(step) for step in steps]).reshape(-1, 2)
        ellipses = [ellipse(_centre(step), fix_covariance(step)) for step in _some(steps, ELLIPSES)]
        axes.add_collection(LineCollection(ellipses, colors=colour, linewidths=0.5, alpha=0.5, zorder=1))
        marker = "." if taken else "x"
        axes.plot(*centres.T, marker, color=colour, markersize=4.0, label=label, zorder=1.5)
    beliefs = [ellipse(*belief) for belief in map(_belief, _some(run.steps, ELLIPSES)) if belief is not None]
    axes.add_collection(LineCollection(beliefs, colors=TRACKS["filtered"][0], linewidths=0.6, zorder=2.5))
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _some(rows: Rows, most: int) -> Rows:
    """Return all rows, or evenly some of too many."""
    return rows[:: max(math.ceil(len(rows) / most), 1)]


def _belief(step: Step) -> tuple[Array, Array] | None:
    """Return position and covariance of the belief after a look, (2,) and (2, 2); None while lost."""
    if not step["x_m"] or not step["sxx"]:
        return None
    sxx, sxy, syy = (float(step[name]) for name in ("sxx", "sxy", "syy"))
    return np.array([float(step["x_m"]), float(step["y_m"])]), np.array([[sxx, sxy], [sxy, syy]])


def _centre(step: Step) -> Array:
    return np.array([float(step["fix_x_m"]), float(step["fix_y_m"])])
