"""The plan of a map: walls, floor, edges by kind, lintels, and how much each view region sees."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from maps.regions import ViewRegions
from maps.rooms import vertical
from maps.wiremap import WireMap
from runs.palette import AMBIGUOUS, COUNTS, kind_colours
from runs.plots import INK, STYLE, png
from runs.shapes import floor_rings

#: Wide enough to tell a window's edges apart in a building of 30 m.
WIDTH_IN = 9.0
#: Room for legend and axis labels; the colour bar stands in a share of the width.
MARGIN_IN, PLAN_SHARE = 1.4, 0.85
#: Air around what is drawn.
MARGIN_M = 0.5

COUNT_COLOURS = LinearSegmentedColormap.from_list("counts", COUNTS)


@matplotlib.rc_context(STYLE)
def draw_map(wire_map: WireMap, regions: ViewRegions, title: str) -> Figure:
    """Draw a map in plan, its view regions coloured by the number of segments that each of them sees."""
    low = np.minimum(wire_map.floor.bounds[:2], wire_map.endpoints[:, :, :2].min(axis=(0, 1))) - MARGIN_M
    high = np.maximum(wire_map.floor.bounds[2:], wire_map.endpoints[:, :, :2].max(axis=(0, 1))) + MARGIN_M
    width, depth = high - low
    height_in = float(np.clip(PLAN_SHARE * WIDTH_IN * depth / width, 2.0, 14.0)) + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_title(title, fontsize=10.0)
    seen = _draw_regions(axes, regions)
    _draw_edges(axes, wire_map)
    bar = figure.colorbar(seen, ax=axes, shrink=0.8, pad=0.01)
    bar.set_label("segments that can be seen from the region")
    bar.outline.set_visible(False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=8, markerscale=2.0)
    return figure


def picture(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the contents of a file, `.png` or `.svg`."""
    if suffix == ".png":
        return png(figure)
    content = BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(content, format="svg", metadata={"Date": None})
    return content.getvalue()


def _draw_regions(axes: Axes, regions: ViewRegions) -> PolyCollection:
    cells = [regions.region(number) for number in range(len(regions))]
    counts = np.array([len(cell.rows) for cell in cells])
    drawn = PolyCollection(
        [cell.corners for cell in cells],
        array=counts,
        cmap=COUNT_COLOURS,
        edgecolors="white",
        linewidths=0.15,
        zorder=0.5,
    )
    drawn.set_clim(0, counts.max(initial=1))
    axes.add_collection(drawn)
    return drawn


def _draw_edges(axes: Axes, wire_map: WireMap) -> None:
    outline: Any = {"colors": INK, "linewidths": 1.4, "capstyle": "round"}
    axes.add_collection(LineCollection(floor_rings(wire_map.floor), zorder=1.0, **outline))
    kinds, upright = np.array(wire_map.kinds), vertical(wire_map.endpoints)
    for kind, colour in kind_colours(wire_map.kinds).items():
        plans = wire_map.endpoints[(kinds == kind) & ~upright][:, :, :2]
        axes.add_collection(LineCollection(list(plans), colors=colour, linewidths=1.2, zorder=2.0))
        # Upright edges are points in plan.
        points = wire_map.endpoints[(kinds == kind) & upright][:, 0, :2]
        dots: Any = {"color": colour, "markeredgecolor": INK, "markeredgewidth": 0.3, "markersize": 3.5}
        axes.plot(*points.T, "o", label=kind, zorder=2.5, **dots)
    if len(wire_map.lintels):
        over = LineCollection(
            list(wire_map.lintels), colors=AMBIGUOUS, linewidths=2.2, label="lintel", zorder=3.0
        )
        axes.add_collection(over)
