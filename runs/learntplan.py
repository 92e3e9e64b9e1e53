"""What was learnt of a map, in plan: how often its edges show, and which of them are suspicious."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from maps.rooms import vertical
from maps.wiremap import WireMap
from runs.mapplan import COUNT_COLOURS, MARGIN_IN, MARGIN_M, PLAN_SHARE, WIDTH_IN
from runs.palette import AMBIGUOUS, REJECTED, TRUTH
from runs.plots import INK, STYLE
from runs.shapes import floor_rings
from vision.maplearning import Fault, LearntMap

_COLOURS = {Fault.MISSING: REJECTED, Fault.MOVED: AMBIGUOUS}


@matplotlib.rc_context(STYLE)
def draw_learnt(wire_map: WireMap, learnt: LearntMap, title: str) -> Figure:
    """Draw the edges coloured by their detection rates, on top those that show most; circle the suspicious."""
    x0, y0, x1, y1 = wire_map.floor.bounds
    width, depth = x1 - x0 + 2.0 * MARGIN_M, y1 - y0 + 2.0 * MARGIN_M
    height_in = float(np.clip(PLAN_SHARE * WIDTH_IN * depth / width, 2.0, 14.0)) + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.set_xlim(x0 - MARGIN_M, x1 + MARGIN_M)
    axes.set_ylim(y0 - MARGIN_M, y1 + MARGIN_M)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_title(title, fontsize=10.0)
    axes.add_collection(LineCollection(floor_rings(wire_map.floor), colors=TRUTH, linewidths=0.7, zorder=0.5))
    looked, upright = learnt.looks > 0, vertical(wire_map.endpoints)
    plans = wire_map.endpoints[:, :, :2]
    unseen = LineCollection(list(plans[~looked & ~upright]), colors=TRUTH, linewidths=0.6, linestyles=":")
    axes.add_collection(unseen)
    scale: Any = {"cmap": COUNT_COLOURS, "norm": matplotlib.colors.Normalize(0.0, 1.0)}
    flat = np.flatnonzero(looked & ~upright)
    flat = flat[np.argsort(learnt.detection_rate[flat])]
    lines = LineCollection(
        list(plans[flat]), array=learnt.detection_rate[flat], linewidths=2.0, zorder=1.0, **scale
    )
    axes.add_collection(lines)
    points = np.flatnonzero(looked & upright)
    x, y = plans[points, 0].T
    dots: Any = {"s": 26.0, "edgecolors": INK, "linewidths": 0.4, "zorder": 2.0, **scale}
    axes.scatter(x, y, c=learnt.detection_rate[points], **dots)
    for suspicion in learnt.suspicions:
        middle, colour = plans[suspicion.row].mean(axis=0), _COLOURS[suspicion.fault]
        mark: Any = {"color": colour, "fillstyle": "none", "markersize": 11.0, "markeredgewidth": 1.6}
        axes.plot(*middle, "o", zorder=3.0, **mark)
        if suspicion.offset_m is not None:
            there = middle + suspicion.offset_m[:2]
            axes.annotate("", there, middle, arrowprops={"arrowstyle": "->", "color": colour}, zorder=3.5)
    bar = figure.colorbar(lines, ax=axes, shrink=0.8, pad=0.01)
    bar.set_label("share of the edge that shows where it should")
    bar.outline.set_visible(False)
    keys = [
        Line2D([], [], color=colour, marker="o", linestyle="none", fillstyle="none", label=f"{fault}?")
        for fault, colour in _COLOURS.items()
    ]
    keys.append(Line2D([], [], color=TRUTH, linestyle=":", label="never in view"))
    figure.legend(handles=keys, loc="outside lower center", ncols=3)
    return figure
