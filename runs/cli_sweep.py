"""The command line's `sweep` command; what it needs is imported when it runs."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from runs.options import JointsOption, RobotOption, TopicOption
from runs.progress import progress_bar


def sweep(
    sessions: Annotated[list[Path], typer.Argument(metavar="SESSION…", help="Session folders, bags, …")],
    *,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where results go; one that was begun is gone on with.")
    ],
    config: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Parameters that differ (YAML); may be repeated."),
    ] = None,
    map_: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map, if not the sessions'.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, max=10_000, metavar="N", help="Seeds 0 to N - 1.")] = 1,
    faults: Annotated[
        str, typer.Option(metavar="A,B", help="Faults as of `session corrupt`, `none`, or `all` of both.")
    ] = "none",
    workers: Annotated[int, typer.Option(min=0, metavar="N", help="Processes; 0 for as many as cores.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask cluster to work on, like tcp://host:8786.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows for programs.")] = False,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Run many sessions, configurations, seeds and faults: results.parquet, a table, a plot."""
    from maps.mapdocument import write_whole
    from runs.experiments.output import Grid
    from runs.faults.kinds import FAULTS
    from runs.faults.table import fault_table, shortfalls
    from runs.plots import png
    from runs.sweep import NONE, sweep_items
    from runs.sweepreport import draw_sweep, failures, sweep_table
    from runs.sweepstore import arrow, open_store, run_sweep, write_results

    arrow()
    kinds = [NONE, *FAULTS] if faults == "all" else [kind.strip() for kind in faults.split(",")]
    items = sweep_items(sessions, config or (), seeds, kinds, map_, robot, topic or (), joints)
    with open_store(out) as folder:
        with progress_bar("sweep") as progress:
            rows = run_sweep(items, folder, progress, workers or os.cpu_count() or 1, scheduler)
        write_results(folder, rows)
        grid: Grid = sweep_table(rows)
        write_whole(folder / "sweep.png", png(draw_sweep(rows)))
        write_whole(folder / "summary.md", _markdown(grid.header, grid.rows, grid.remark).encode())
        if any(kind != NONE for kind in kinds):
            by_fault, short = fault_table(rows), "".join(f"- {line}\n" for line in shortfalls(rows))
            text = _markdown(by_fault.header, by_fault.rows, by_fault.remark)
            write_whole(folder / "faults.md", "\n".join([text, short] if short else [text]).encode())
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
    else:
        _show(grid.header, grid.rows)
    for line in failures(rows):
        typer.echo(f"wireloc: failed: {line}", err=True)
    typer.echo(str(out), err=as_json)
    if all(row["status"] != "ok" for row in rows):
        raise typer.Exit(1)


def _show(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...]) -> None:
    console = Console()
    if not console.is_terminal:
        console.width = 10_000
    table = Table(box=SIMPLE_HEAD)
    for number, name in enumerate(header):
        table.add_column(Text(name), justify="right" if number > 2 else "left")
    for row in rows:
        table.add_row(*map(Text, row))
    console.print(table)


def _markdown(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...], remark: str) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join([*(f"| {' | '.join(cells)} |" for cells in lines), "", remark, ""])
