"""The command line's `view` and `compare` commands; what they need is imported when they run."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from runs.compare import Comparison

#: Median, p95, max and rmse of errors, None where not known.
Spread = Mapping[str, float | None]


def view_run(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, comparison folder, or .rrd file.")],
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a picture instead; needs no screen.")
    ] = None,
    time: Annotated[float | None, typer.Option(metavar="S", help="Time to show, with --screenshot.")] = None,
    tab: Annotated[
        str,
        typer.Option(metavar="TAB", help="Tab to show, with --screenshot: where, why, trust, speed, run."),
    ] = "where",
) -> None:
    """Open a run's recording in the viewer."""
    from runs.viewer import screenshot as take_screenshot
    from runs.viewer import view

    if screenshot is None:
        view(run)
    else:
        take_screenshot(run, screenshot, time, tab)


def compare_runs(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where tables, plots, recording go.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Set odometry, raw vision, filtered, fixed-lag and smoothed poses side by side, of one run or of several."""
    from runs.compare import compare

    compared = compare(runs, out)
    if as_json:
        typer.echo(json.dumps(compared.content(), allow_nan=False))
        return
    _print_comparison(compared)


def error_table(rows: Iterable[tuple[str, Spread, Spread]]) -> Table:
    """Lay out rows of a name, position errors [m] and heading errors [deg]."""
    figures = ("median", "p95", "max", "rmse")
    table = Table("error", "", box=SIMPLE_HEAD)
    for figure in figures:
        table.add_column(figure, justify="right")
    for name, position_m, heading_deg in rows:
        for label, unit, spread in ((name, "m", position_m), ("", "deg", heading_deg)):
            values = [spread[figure] for figure in figures]
            table.add_row(label, unit, *("-" if value is None else f"{value:.3f}" for value in values))
    return table


def _print_comparison(compared: Comparison) -> None:
    """Print the table, what the errors are against, and where to find more."""
    from runs.comparepage import HEADER, table_rows

    # Elsewhere than on a terminal a table may be as wide as it is.
    console = Console() if sys.stdout.isatty() else Console(width=200)
    table = Table(HEADER[0], box=SIMPLE_HEAD)
    for column in HEADER[1:]:
        table.add_column(column, justify="right")
    for cells in table_rows(compared.rows):
        table.add_row(*map(Text, cells))
    console.print(table)
    console.print(Text(compared.remark), soft_wrap=True)
    console.print(str(compared.folder), soft_wrap=True, highlight=False, markup=False)
