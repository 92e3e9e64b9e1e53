"""The tables and figures of the search's size, and their page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from runs.experiments.cases import CASES
from runs.experiments.complexity import complexity
from runs.experiments.output import Drawing, Grid, Report, figure_text
from runs.experiments.synthetic import Trial
from runs.experiments.syntheticfigures import colours_of, new_figure
from runs.palette import FILTERED, ODOMETRY, SMOOTHED
from runs.plots import INK, STYLE

_SPLIT = ("mv", "mh", "n", "nv", "pairs", "couples", "combinations_h", "combinations_v")
_COUNTED = (*_SPLIT, "products", "hypotheses")
_LOGARITHMS = ("log10_one_tree", "log10_two_trees", "log10_product", "log10_gain")


def complexity_report(
    trials: Sequence[Trial],
    cases: Sequence[str],
    images: int,
    seed: int,
    zones: Sequence[tuple[int, int]] = (),
) -> Report:
    """Lay out formula, zones, counts and growth; `zones` as `complexity` takes them."""
    content = complexity(trials, cases, images, seed, zones)
    grids = [_formula(content), _zones(content), _growth(content)]
    drawings = [Drawing("growth", "Time against lines in the image", _growth_figure(content))]
    if content["counts"]:
        grids.insert(1, _images(content))
        drawings.insert(0, Drawing("search_space", "The search space of each image", _space_figure(content)))
    header = ("image", "method", *_COUNTED, *_LOGARITHMS)
    rows = [tuple(count[name] for name in header) for count in content["counts"]]
    return Report("complexity", "Size of the search", content, tuple(grids), tuple(drawings), (header, *rows))


def _formula(content: dict[str, Any]) -> Grid:
    example = content["example"]
    setting = ", ".join(f"{name} = {example[name]}" for name in ("mv", "mh", "n", "nv"))
    rows = (
        ("(n + 1)^m / ((n + 1)^mh + (nv + 1)^mv)", setting, f"{example['gain']:,.0f}"),
        ("as printed: n^mh for (n + 1)^mh", setting, f"{example['printed_gain']:,}"),
    )
    return Grid("Gain of two trees over one, the paper's example", ("", "", "gain"), rows)


def _images(content: dict[str, Any]) -> Grid:
    rows = []
    for name in (*_COUNTED, *_LOGARITHMS):
        values = np.array([count[name] for count in content["counts"]], float)
        digits = 1 if name in _LOGARITHMS else 0
        percentiles = np.percentile(values, [10.0, 50.0, 90.0, 100.0])
        rows.append((name, "", *(figure_text(float(value), digits) for value in percentiles)))
    remark = f"{content['images']} images, {CASES[content['growth'][0]['points'][0]['case']].title}, QI 3."
    return Grid("Counts of the images", ("", "", "10 %", "median", "90 %", "max"), tuple(rows), remark)


def _zones(content: dict[str, Any]) -> Grid:
    rows = tuple(
        (
            f"{zone['dt_m']:.2f} m, {zone['dphi_deg']:.0f}°",
            f"at {zone['distance_m']:.0f} m",
            f"{zone['likely_px']:.0f}",
            f"{zone['worst_px']:.0f}",
            f"{100.0 * zone['likely_share_of_image']:.0f} %",
        )
        for zone in content["zones"]
    )
    remark = "The paper says about 400 px for the first row. Worst: both errors at their limits, on one side."
    if content["zone_pairs_kept_share"] is not None:
        left = 100.0 * content["zone_pairs_kept_share"]
        remark += f" On these images the zones leave {left:.0f} % of all pairs of an edge and a line"
        shares = [
            f"{found['method']}: {100.0 * found['pairs_kept_share']:.1f} %"
            for found in content["selection"]
            if found["pairs_kept_share"] is not None
        ]
        remark += f"; constraints leave {', '.join(shares)} (non-vertical edges)." if shares else "."
    header = ("estimate", "edge", "zone, px", "worst, px", "share of the image")
    return Grid("Where De Souza and Kak would search one edge", header, rows, remark)


def _growth(content: dict[str, Any]) -> Grid:
    rows = tuple(
        (
            CASES[point["case"]].title,
            found["method"],
            figure_text(point["lines"], 0),
            figure_text(point["products"], 0),
            figure_text(point["hypotheses"], 0),
            figure_text(point["ms"], 1),
            figure_text(point["p90_ms"], 1),
            str(point["exhausted"]),
        )
        for found in content["growth"]
        for point in found["points"]
    )
    exponents = [
        f"{found['method']}: {name} ~ lines^{found[key]:.1f}"
        for found in content["growth"]
        for name, key in (("time", "ms_exponent"), ("products", "products_exponent"))
        if found[key] is not None
    ]
    remark = (
        f"Medians of {content['images']} images, QI 3. {'; '.join(exponents)}. Products: of both trees' "
        "combinations. Cut: images whose search ended at a limit."
    )
    header = ("case", "method", "lines", "products", "hypotheses", "ms", "90 %", "cut")
    return Grid("Growth with the number of lines", header, rows, remark)


@matplotlib.rc_context(STYLE)
def _growth_figure(content: dict[str, Any]) -> Figure:
    figure = new_figure(3.2)
    axes = figure.subplots()
    colours = colours_of([found["method"] for found in content["growth"]])
    for found in content["growth"]:
        lines = [point["lines"] for point in found["points"]]
        for name, style in (("ms", "o-"), ("p90_ms", ":")):
            label = found["method"] if name == "ms" else None
            values = [point[name] for point in found["points"]]
            axes.plot(lines, values, style, color=colours[found["method"]], label=label, markersize=4.0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("lines in the image")
    axes.set_ylabel("ms (median; dotted: 90 %)")
    axes.grid(visible=True)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@matplotlib.rc_context(STYLE)
def _space_figure(content: dict[str, Any]) -> Figure:
    counts = sorted(content["counts"], key=lambda count: count["log10_one_tree"])
    figure = new_figure(3.2)
    axes = figure.subplots()
    curves = {
        "one tree": ([count["log10_one_tree"] for count in counts], ODOMETRY),
        "two trees": ([count["log10_two_trees"] for count in counts], FILTERED),
        "kept": ([np.log10(max(count["hypotheses"], 1)) for count in counts], SMOOTHED),
    }
    for label, (values, colour) in curves.items():
        axes.plot(values, color=colour, label=label)
    axes.plot([count["log10_product"] for count in counts], color=INK, linestyle="--", label="product")
    axes.set_xlabel("image, sorted")
    axes.set_ylabel("combinations, power of ten")
    axes.grid(visible=True)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
