"""What a sweep found: a table by session, configuration and fault, and a plot of errors."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from runs.experiments.output import Grid, figure_text
from runs.faults.table import untold
from runs.plots import STYLE, blank_figure
from runs.sweep import Row

_GROUP = ("session", "config", "fault")
_HEADER = (
    *_GROUP, "runs", "failed", "RMSE m", "max m", "RMSE °", "available", "wrong fixes",
    "wrong s", "wrong looks", "recovered", "lost after",
)  # fmt: skip


#: Colours that tell apart.
_MOST_COLOURS = 10


def sweep_table(rows: Sequence[Row]) -> Grid:
    """Return a row a group of seeds: medians of the errors, the worst of everything else."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(str(row[name]) for name in _GROUP), []).append(row)
    return Grid(
        "Sweep",
        _HEADER,
        tuple((*names, *_cells(group)) for names, group in groups.items()),
        "Filtered pose: RMSE is the median over seeds, the rest the worst. Wrong s: longest time TRACKING with the "
        "pose over 0.5 m or 10° off, once it was so for three observable frames; wrong looks: most such frames on "
        "end that left it so. Recovered: observable frames after the fault's end until the pose is right again, - "
        "for never, no end, or too few left to tell. Lost after: frames until the first LOST.",
    )


def failures(rows: Sequence[Row]) -> list[str]:
    """Return a line for each item that failed: which, and why."""
    return [
        f"{row['session']}, {row['config']}, {row['fault']}, seed {row['seed']}: {row['error']}"
        for row in rows
        if row["status"] == "failed"
    ]


@matplotlib.rc_context(STYLE)
def draw_sweep(rows: Sequence[Row]) -> Figure:
    """Draw each run's filtered RMSE as a dot, faults below each other, sessions and configurations by colour.

    More of them than there are colours share one: configurations have theirs then.
    """
    done = [row for row in rows if isinstance(row.get("filtered_rmse_m"), float)]
    faults = list(dict.fromkeys(str(row["fault"]) for row in done))
    names = [f"{row['session']}, {row['config']}" for row in done]
    if len(set(names)) > _MOST_COLOURS:
        names = [str(row["config"]) for row in done]
    kinds = list(dict.fromkeys(names))
    figure = blank_figure(1.2 + 0.11 * len(kinds) + 0.22 * max(len(faults), 2))
    axes = figure.subplots()
    for number, kind in enumerate(kinds):
        mine = [row for row, name in zip(done, names, strict=True) if name == kind]
        offset = 0.5 * ((number + 0.5) / len(kinds) - 0.5)
        places = [faults.index(str(row["fault"])) + offset for row in mine]
        axes.plot(
            [_number(row["filtered_rmse_m"]) for row in mine],
            places,
            "o",
            markersize=3.5,
            label=kind,
        )
    axes.set_yticks(range(len(faults)), faults)
    axes.invert_yaxis()
    axes.set_xlabel("filtered position RMSE, m")
    axes.grid(visible=True, axis="x")
    if done:
        axes.set_xscale("log")
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _cells(group: Sequence[Row]) -> tuple[str, ...]:
    worst = {
        name: _worst(group, name) for name in ("filtered_max_m", "wrong", "wrong_settled_s", "wrong_looks")
    }
    available = [_number(row["availability"]) for row in group if row.get("availability") is not None]
    recovered = [row.get("recovered_after") for row in group if row["status"] != "failed" and not untold(row)]
    lost = [row.get("lost_after") for row in group if row["status"] != "failed"]
    return (
        str(len(group)),
        str(sum(row["status"] == "failed" for row in group)),
        figure_text(_median(group, "filtered_rmse_m"), 3),
        figure_text(worst["filtered_max_m"], 2),
        figure_text(_median(group, "filtered_rmse_deg"), 2),
        f"{100.0 * min(available):.0f} %" if available else "-",
        figure_text(worst["wrong"], 0),
        figure_text(worst["wrong_settled_s"], 1),
        figure_text(worst["wrong_looks"], 0),
        _latest(recovered),
        _latest(lost),
    )


def _latest(counts: Sequence[object]) -> str:
    """Write the largest of counts, a dash where one of them never came."""
    numbers = [count for count in counts if isinstance(count, int)]
    return str(max(numbers)) if numbers and len(numbers) == len(counts) else "-"


def _values(group: Sequence[Row], name: str) -> list[float]:
    return [_number(row[name]) for row in group if row.get(name) is not None]


def _median(group: Sequence[Row], name: str) -> float | None:
    values = _values(group, name)
    return float(np.median(values)) if values else None


def _worst(group: Sequence[Row], name: str) -> float | None:
    values = _values(group, name)
    return max(values) if values else None


def _number(value: str | int | float | None) -> float:
    assert isinstance(value, int | float)
    return float(value)
