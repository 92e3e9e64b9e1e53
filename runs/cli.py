"""The command line: one thin function a command; what they need is imported when they run."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from datetime import datetime
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from maps.errors import InputError, WirelocError
from runs.cli_calibrate import calibrate_camera
from runs.cli_experiment import experiment_app
from runs.cli_lines import extract_lines
from runs.cli_locate import locate_image
from runs.cli_map import map_app
from runs.cli_simulate import simulate
from runs.options import numbers

if TYPE_CHECKING:
    from runs import runner
    from runs.session import Session

#: Median, p95, max and rmse of errors, None where not known.
Spread = Mapping[str, float | None]

#: How well a pose given on the command line is known, where nobody says: a mark on the floor.
INITIAL_STD = "0.1,5"

app = typer.Typer(
    name="wireloc",
    help="Tell a wheeled robot where it is inside a known building, from its camera, wheels and a map.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(map_app, name="map")
app.add_typer(experiment_app, name="experiment")
app.command("lines")(extract_lines)
app.command("locate")(locate_image)
app.command("calibrate")(calibrate_camera)
app.command("simulate")(simulate)


def main() -> None:
    """Run the command line; bad input is told in one line, with exit code 2."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        # On two cores a second thread costs far more than it brings.
        os.environ.setdefault(name, "1")
    logging.basicConfig(level=logging.WARNING, format="wireloc: %(message)s")
    try:
        app()
    except (WirelocError, OSError) as error:
        typer.echo(f"wireloc: {' '.join(str(error).split())}", err=True)
        sys.exit(2)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wireloc {version('wireloc')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Tell a wheeled robot where it is inside a known building, from its camera, wheels and a map."""


@app.command()
def run(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="Session folder.")],
    map_: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map, if not the session's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Run folder.")] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameters that differ (YAML).")
    ] = None,
    initial_pose: Annotated[
        str | None, typer.Option(metavar="X,Y[,PHI]", help="Pose at the first event: metres, radians.")
    ] = None,
    initial_std: Annotated[
        str | None,
        typer.Option(metavar="DT_M,DPHI_DEG", help=f"How well it is known; {INITIAL_STD} unless told."),
    ] = None,
    lost: Annotated[bool, typer.Option("--lost", help="Ignore the initial pose.")] = False,
    view: Annotated[bool, typer.Option("--view", help="Open the recording at the end.")] = False,
) -> None:
    """Run a whole navigation session: table, run folder, recording."""
    from runs.config import RunConfig, read_config
    from runs.navigation import navigate
    from runs.results import default_folder, point_latest
    from runs.session import read_session

    parameters = read_config(config) if config else RunConfig()
    drive = _started(read_session(session, map_), initial_pose, initial_std, lost)
    folder = out or default_folder(drive.name, datetime.now())
    with _progress(drive.name) as progress:
        navigation = navigate(drive, parameters, folder, progress)
    if out is None:
        point_latest(folder)
    _print_result(navigation.metrics, folder)
    if view:
        _open(folder)
    if not navigation.usable:
        typer.echo("wireloc: no fix was accepted", err=True)
        raise typer.Exit(1)


@app.command("view")
def view_run(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a picture instead; needs no screen.")
    ] = None,
    time: Annotated[float | None, typer.Option(metavar="S", help="Time to show, with --screenshot.")] = None,
) -> None:
    """Open a run's recording in the viewer."""
    if screenshot is None:
        _open(run)
        return
    from runs.viewer import screenshot as take_screenshot

    take_screenshot(run, screenshot, time)


@app.command("compare")
def compare_runs(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where table and plots go.")] = None,
) -> None:
    """Set odometry, raw vision, filtered and smoothed poses side by side."""
    from runs.compare import compare

    compared = compare(runs, out)
    console = Console()
    for name, rows in groupby(compared.rows, key=lambda row: row.run):
        console.print(name, soft_wrap=True, highlight=False, markup=False)
        console.print(
            _error_table((row.track, asdict(row.position_m), asdict(row.heading_deg)) for row in rows)
        )
    console.print(str(compared.folder), soft_wrap=True, highlight=False, markup=False)


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where robot.yaml and map.yaml go.")],
) -> None:
    """Write a robot.yaml and a map.yaml of a small room, to edit."""
    from runs.templates import write_templates

    for path in write_templates(folder):
        typer.echo(str(path))


def _open(run: Path) -> None:
    from runs.viewer import view

    view(run)


def _started(session: Session, pose: str | None, std: str | None, lost: bool) -> Session:
    """Return the session with the initial belief that the command line asks for."""
    from maps.poses import Pose2
    from runs.robot import Start

    if lost:
        return replace(session, initial=None)
    if pose is None:
        if std is not None:
            raise InputError("--initial-std", "", "says nothing without --initial-pose")
        return session
    x, y, *phi = numbers("--initial-pose", pose, "X,Y[,PHI]", (2, 3))
    position_std_m, heading_std_deg = numbers("--initial-std", std or INITIAL_STD, "DT_M,DPHI_DEG", (2,))
    if position_std_m <= 0.0 or heading_std_deg <= 0.0:
        raise InputError("--initial-std", "", "not above zero")
    heading_std_rad = math.radians(heading_std_deg) if phi else math.inf
    start = Start(Pose2(x, y, phi[0] if phi else 0.0), position_std_m, position_std_m, heading_std_rad)
    return replace(session, initial=start.at(session.start_ns))


@contextmanager
def _progress(name: str) -> Iterator[runner.Progress]:
    """Show a bar on a terminal; elsewhere nothing."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _print_result(metrics: dict[str, Any], folder: Path) -> None:
    """Print the table, the fixes, and where to find more."""
    console = Console()
    vision = metrics["vision"]
    if vision["wrong"] is None:
        console.print("no ground truth: errors are not known")
    else:
        names = {
            "odometry": "odometry",
            "vision": "raw vision",
            "filtered": "filtered",
            "smoothed": "smoothed",
        }
        errors = ((name, metrics[key]) for key, name in names.items())
        console.print(
            _error_table((name, of["position_error_m"], of["heading_error_deg"]) for name, of in errors)
        )
    wrong = "" if vision["wrong"] is None else f", {vision['wrong']} wrong"
    console.print(
        f"{vision['attempted']} looks: {vision['fixes']} fixes, {vision['partial']} partial; "
        f"{vision['accepted']} accepted, {vision['rejected']} rejected{wrong}",
        highlight=False,
    )
    console.print(str(folder), soft_wrap=True, highlight=False, markup=False)
    console.print(f"wireloc view {folder}", soft_wrap=True, highlight=False, markup=False)


def _error_table(rows: Iterable[tuple[str, Spread, Spread]]) -> Table:
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
