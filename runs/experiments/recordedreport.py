"""Table 4 of a recorded session beside the paper's, and its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, fields
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from runs.experiments.output import Drawing, Grid, Report, figure_text
from runs.experiments.published import TABLE_4
from runs.experiments.recorded import Look, session_summary
from runs.experiments.syntheticfigures import colours_of, new_figure
from runs.plots import INK, STYLE


def session_report(looks: Sequence[Look], name: str, seed: int) -> Report:
    """Lay out all frames and methods; the page shows as many frames as table 4, evenly over the session."""
    content = session_summary(looks, name, seed)
    grids = (_results(content), _table_4(looks))
    drawings = (
        Drawing(
            "errors",
            "Errors of the fixes",
            _errors(looks),
            "Shares are of all frames, partial fixes left out. Dashed: the paper's table 4, of its ten images.",
        ),
    )
    header = tuple(field.name for field in fields(Look))
    rows = tuple(tuple("" if cell is None else cell for cell in astuple(look)) for look in looks)
    return Report("session", f"{name}, frame by frame", content, grids, drawings, (header, *rows))


def _results(content: dict[str, Any]) -> Grid:
    paper = [row for row in TABLE_4 if row is not None]
    rows = [
        (
            "the paper's",
            *(str(len(paper)), "-", "-", str(len(TABLE_4) - len(paper)), "-"),
            figure_text(float(np.median([row.heading_deg for row in paper]))),
            figure_text(float(np.median([row.position_m for row in paper]))),
            figure_text(float(np.median([row.hypotheses for row in paper])), 0),
            figure_text(float(np.median([row.correspondences for row in paper])), 0),
            *("-", "-"),
        )
    ]
    for result in content["results"]:
        counts = (result[key] for key in ("fixes", "partial", "ambiguous", "no_fix", "wrong"))
        rows.append(
            (
                result["method"],
                *map(str, counts),
                figure_text(result["heading_error_deg"]["median"]),
                figure_text(result["position_error_m"]["median"], 3),
                figure_text(result["hypotheses"], 0),
                figure_text(result["correspondences"], 0),
                str(result["exhausted"]),
                figure_text(result["ms"], 1),
            )
        )
    header = (
        "method",
        *("fixes", "partial", "ambiguous", "none", "wrong"),
        *("Δφ, deg", "Δt, m", "hyp.", "corr.", "cut", "ms"),
    )
    remark = (
        f"{content['images']} frames, seed {content['seed']}, estimates of QI 3 about the truth; medians. "
        "Wrong: whole fixes more than 0.30 m or 5° off. Cut: enumerations that ended at their budget."
    )
    return Grid("Fixes", header, tuple(rows), remark)


def _table_4(looks: Sequence[Look]) -> Grid:
    """The paper's ten rows beside as many frames, evenly over the session."""
    methods = list(dict.fromkeys(look.method for look in looks))
    names = list(dict.fromkeys(look.filename for look in looks))
    shown = [names[n] for n in np.unique(np.linspace(0, len(names) - 1, len(TABLE_4)).round().astype(int))]
    by_frame = {(look.filename, look.method): look for look in looks}
    rows = []
    for number, paper in enumerate(TABLE_4):
        cells = [str(number + 1)]
        if paper is None:
            cells += ["none", "", "", ""]
        else:
            cells += [f"{paper.heading_deg}", f"{paper.position_m:.2f}"]
            cells += [str(paper.hypotheses), str(paper.correspondences)]
        if number < len(shown):
            cells.append(shown[number])
            for method in methods:
                cells += _cells(by_frame[shown[number], method])
        else:
            cells += [""] * (1 + 4 * len(methods))
        rows.append(tuple(cells))
    columns = ("Δφ, deg", "Δt, m", "hyp.", "corr.")
    header = ("image", *(f"paper: {name}" for name in columns), "frame")
    header += tuple(f"{method}: {name}" for method in methods for name in columns)
    remark = (
        "The paper's images are of another building and camera: the columns are side by side for orientation."
    )
    return Grid("Table 4", header, tuple(rows), remark)


def _cells(look: Look) -> list[str]:
    if look.heading_deg is None or look.position_m is None:
        return [look.outcome.lower(), "", str(look.hypotheses), ""]
    heading = f"{look.heading_deg:.2f}" + (" (partial)" if look.outcome == "PARTIAL" else "")
    return [heading, f"{look.position_m:.3f}", str(look.hypotheses), str(look.correspondences)]


@matplotlib.rc_context(STYLE)
def _errors(looks: Sequence[Look]) -> Figure:
    methods = list(dict.fromkeys(look.method for look in looks))
    figure = new_figure(3.2)
    panels = figure.subplots(1, 2, sharey=True)
    paper = [row for row in TABLE_4 if row is not None]
    for axes, key, label in zip(
        panels, ("heading_deg", "position_m"), ("heading, deg", "position, m"), strict=True
    ):
        for method, colour in colours_of(methods).items():
            own = [look for look in looks if look.method == method]
            errors = np.sort([getattr(look, key) for look in own if look.outcome == "FIX"])
            axes.plot(errors, 100.0 * np.arange(1, len(errors) + 1) / len(own), color=colour, label=method)
        errors = np.sort([getattr(row, key) for row in paper])
        shares = 100.0 * np.arange(1, len(errors) + 1) / len(TABLE_4)
        axes.plot(errors, shares, color=INK, linestyle="--", linewidth=1.0, label="the paper's")
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_ylim(0.0, 100.0)
        axes.set_xlabel(label)
        axes.grid(visible=True)
    panels[0].set_ylabel("share of frames, %")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
