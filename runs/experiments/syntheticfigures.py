"""Figures of the synthetic experiment: hypotheses (the paper's figure 11), outcomes, errors, times."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from maps.poses import Array
from runs.experiments.judging import Category
from runs.experiments.synthetic import Trial, of
from runs.palette import AMBIGUOUS, FILTERED, ODOMETRY, REJECTED, SMOOTHED, TRUTH, VISION
from runs.plots import INK, STYLE, WIDTH_IN

#: Each method's colour, and those of methods that are not known here.
COLOURS = {"paper": ODOMETRY, "default": FILTERED}
OTHER_COLOURS = (SMOOTHED, AMBIGUOUS)
OUTCOMES = {
    Category.SUCCESS: (SMOOTHED, "success"),
    Category.CONSISTENT: (VISION, "consistent false positive"),
    Category.AMBIGUOUS: (AMBIGUOUS, "ambiguous"),
    Category.FALSE_NEGATIVE: (TRUTH, "false negative"),
    Category.INCONSISTENT: (REJECTED, "inconsistent false positive"),
}
#: Poses drawn from each image's bound, for the curve of what a perfect method would reach.
_DRAWS = 200


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return an empty figure as wide as the page's text."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def colours_of(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each name."""
    others = cycle(OTHER_COLOURS)
    return {name: COLOURS.get(name) or next(others) for name in dict.fromkeys(names)}


@matplotlib.rc_context(STYLE)
def hypotheses(trials: Sequence[Trial], methods: Sequence[str], case: str) -> Figure:
    """Draw hypotheses kept against the number there could be, images sorted by the latter: figure 11."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    colours = colours_of(methods)
    order = np.arange(len(of(trials, methods[0], case)))
    for method in methods:
        counts = [trial.counts for trial in of(trials, method, case) if trial.counts is not None]
        if len(counts) == len(order):
            most = 10.0 ** np.minimum([count.log10_most for count in counts], 300.0)
            order = np.argsort(most)
            axes.plot(most[order], color=INK, linewidth=1.2, linestyle="--", label="without pruning")
    for method in methods:
        kept = np.array([max(trial.hypotheses, 0.8) for trial in of(trials, method, case)])
        axes.plot(kept[order], ".", color=colours[method], markersize=3.0, label=method)
    axes.set_yscale("log")
    axes.set_xlabel("image, sorted")
    axes.set_ylabel("hypotheses")
    axes.grid(visible=True)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@matplotlib.rc_context(STYLE)
def outcomes(trials: Sequence[Trial], methods: Sequence[str], cases: Sequence[str]) -> Figure:
    """Draw what became of the images: a bar for each case and method."""
    bars = [(case, method) for case in cases for method in methods]
    figure = new_figure(1.2 + 0.24 * len(bars))
    axes = figure.subplots()
    left = np.zeros(len(bars))
    for category, (colour, label) in OUTCOMES.items():
        share = [
            100.0 * np.mean([trial.category is category for trial in of(trials, method, case)])
            for case, method in bars
        ]
        axes.barh(range(len(bars)), share, left=left, color=colour, label=label, height=0.75)
        left = left + share
    axes.set_yticks(range(len(bars)), [f"{case}  {method}" for case, method in bars])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of images, %")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


@matplotlib.rc_context(STYLE)
def position_errors(trials: Sequence[Trial], methods: Sequence[str], case: str) -> Figure:
    """Draw which share of all images has a fix better than an error, beside what the bound allows."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    colours = colours_of(methods)
    for method in methods:
        found = of(trials, method, case)
        errors = np.array([trial.position_error_m for trial in found])
        errors = np.sort(errors[np.isfinite(errors)])
        shares = 100.0 * np.arange(1, len(errors) + 1) / len(found)
        axes.plot(errors, shares, color=colours[method], label=method)
    bound = _allowed(of(trials, methods[0], case))
    axes.plot(
        bound, np.linspace(0.0, 100.0, len(bound)), color=INK, linewidth=1.0, linestyle="--", label="bound"
    )
    axes.set_xscale("log")
    axes.set_xlim(max(bound[len(bound) // 200], 1e-4), max(10.0 * bound[-1], 1.0))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylim(0.0, 100.0)
    axes.set_xlabel("position error, m")
    axes.set_ylabel("share of images, %")
    axes.grid(visible=True)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _allowed(trials: Sequence[Trial]) -> Array:
    """Sorted position errors of a method that reaches the bound of each image."""
    rng = np.random.default_rng(0)
    spread = np.array([np.linalg.cholesky(trial.bound[:2, :2]) for trial in trials])
    draws = spread @ rng.standard_normal((len(trials), 2, _DRAWS))
    return np.sort(np.linalg.norm(draws, axis=1).ravel())


@matplotlib.rc_context(STYLE)
def stage_times(results: Sequence[dict[str, Any]], case: str) -> Figure:
    """Draw the median milliseconds of every stage of every method."""
    rows = [
        (f"{result['method']}: {stage}", result["method"], value)
        for result in results
        if result["case"] == case
        for stage, value in result["stage_ms"].items()
    ]
    figure = new_figure(0.9 + 0.24 * len(rows))
    axes = figure.subplots()
    colours = colours_of([result["method"] for result in results])
    values = [max(value, 1e-3) for _, _, value in rows]
    axes.barh(range(len(rows)), values, color=[colours[method] for _, method, _ in rows], height=0.7)
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("median time, ms")
    axes.grid(visible=True, axis="x")
    return figure
