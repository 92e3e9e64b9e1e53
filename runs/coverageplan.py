"""Coverage in plan: how well each heading would be fixed, at best, and where a place may be mistaken."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from maps.poses import Array
from maps.wiremap import WireMap
from runs.coverage import FIX_M, GOOD_M, Coverage
from runs.palette import AMBIGUOUS, COVERAGE
from runs.plots import INK, STYLE
from runs.shapes import floor_rings

#: The classes of a fix's standard deviation [m]: each colour up to its limit.
LIMITS_M = (0.02, GOOD_M, FIX_M, np.inf)
NAMES = ("under 2 cm", "2 to 5 cm", "5 to 15 cm", "over 15 cm", "unconstrained")

#: A building wider than this times its depth has its panels one above the other.
WIDE = 1.3
PANEL_IN, MARGIN_M = 6.4, 0.4
#: How much of a cell its wedges fill.
FILL = 0.94
#: The share of headings with look-alikes from which a cell's colour is full.
_FULL_SHARE = 0.5


def sigma_class(sigma_m: Array) -> Array:
    """Return the class of each standard deviation, 0 the best, `len(LIMITS_M)` unconstrained; same shape."""
    classes = np.searchsorted(LIMITS_M[:-1], sigma_m, side="right")
    result: Array = np.where(np.isfinite(sigma_m), classes, len(LIMITS_M))
    return result


@matplotlib.rc_context(STYLE)
def draw_coverage(wire_map: WireMap, coverage: Coverage, title: str) -> Figure:
    """Draw three plans: every heading, the best heading, the share of headings with look-alikes."""
    x0, y0, x1, y1 = wire_map.floor.bounds
    width, depth = x1 - x0 + 2.0 * MARGIN_M, y1 - y0 + 2.0 * MARGIN_M
    rows, columns = (3, 1) if width > WIDE * depth else (1, 3)
    panel = min(PANEL_IN, PANEL_IN * width / depth) if columns > 1 else PANEL_IN
    tall = float(np.clip(panel * depth / width, 1.5, 9.0))
    figure = Figure(figsize=(columns * panel + 0.6, rows * (tall + 0.35) + 1.0), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=10.0)
    every, best, alike = np.ravel(figure.subplots(rows, columns))
    _draw_headings(every, coverage)
    _draw_best(best, coverage)
    _draw_twins(alike, coverage)
    for axes, name in (
        (every, "a wedge a heading: position of a fix, worst direction"),
        (best, "the best heading"),
        (alike, "headings with look-alikes elsewhere"),
    ):
        axes.set_title(name, fontsize=9.0, loc="left")
        axes.set_aspect("equal")
        axes.set_xlim(x0 - MARGIN_M, x1 + MARGIN_M)
        axes.set_ylim(y0 - MARGIN_M, y1 + MARGIN_M)
        axes.tick_params(labelsize=8.0)
        _clip(axes, wire_map)
        outline = LineCollection(floor_rings(wire_map.floor), colors=INK, linewidths=1.1, zorder=3.0)
        axes.add_collection(outline)
        edges = LineCollection(list(wire_map.endpoints[:, :, :2]), colors=INK, linewidths=0.5, alpha=0.35)
        axes.add_collection(edges)
    (every if columns > 1 else alike).set_xlabel("x, m")
    every.set_ylabel("y, m")
    keys = [Patch(facecolor=colour, label=name) for colour, name in zip(COVERAGE, NAMES, strict=True)]
    keys.append(Patch(facecolor=AMBIGUOUS, label=f"look-alikes in {_FULL_SHARE:.0%} of headings, or more"))
    figure.legend(handles=keys, loc="outside lower center", ncols=3)
    return figure


def _draw_headings(axes: Axes, coverage: Coverage) -> None:
    """A disc of wedges a cell: each wedge points where the robot looks."""
    half = np.pi / len(coverage.headings)
    arcs = coverage.headings[:, None] + np.linspace(-half, half, 5)
    rim = np.stack([np.cos(arcs), np.sin(arcs)], axis=2)
    wedges = np.concatenate([np.zeros((len(rim), 1, 2)), rim], axis=1) * 0.5 * FILL * coverage.cell_m
    shapes = (coverage.places[:, None, None] + wedges).reshape(-1, *wedges.shape[1:])
    colours = _colours(coverage.worst_sigma_m.ravel())
    axes.add_collection(PolyCollection(list(shapes), facecolors=colours, edgecolors="none", zorder=1.0))


def _draw_best(axes: Axes, coverage: Coverage) -> None:
    colours = _colours(coverage.worst_sigma_m.min(axis=1))
    axes.add_collection(PolyCollection(cells(coverage), facecolors=colours, edgecolors=colours, zorder=1.0))


def _draw_twins(axes: Axes, coverage: Coverage) -> None:
    share = np.minimum(coverage.mistakable.mean(axis=1) / _FULL_SHARE, 1.0)
    faint = PolyCollection(
        cells(coverage), facecolors=COVERAGE[-1], edgecolors="none", alpha=0.35, zorder=1.0
    )
    axes.add_collection(faint)
    axes.add_collection(
        PolyCollection(cells(coverage), facecolors=AMBIGUOUS, edgecolors="none", alpha=share, zorder=1.5)
    )


def cells(coverage: Coverage) -> list[Array]:
    """Return the cells' corners, (4, 2) each."""
    square = 0.5 * coverage.cell_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return list(coverage.places[:, None] + square)


def _clip(axes: Axes, wire_map: WireMap) -> None:
    """Let what is drawn so far end at the floor's outline."""
    rings = [Path(ring, closed=True) for ring in floor_rings(wire_map.floor)]
    outline = PathPatch(Path.make_compound_path(*rings), transform=axes.transData)
    for drawn in axes.collections:
        drawn.set_clip_path(outline)


def _colours(sigma_m: Array) -> list[str]:
    return [COVERAGE[number] for number in sigma_class(sigma_m).astype(int).tolist()]
