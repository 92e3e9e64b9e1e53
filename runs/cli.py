"""The command line: one thin function a command; what they need is imported when they run."""

from __future__ import annotations

import logging
import math
import os
import sys
from dataclasses import replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from maps.errors import InputError, WirelocError
from runs.cli_calibrate import calibrate_camera
from runs.cli_calibraterobot import calibrate_robot_command
from runs.cli_compare import compare_runs, error_table, view_run
from runs.cli_experiment import experiment_app
from runs.cli_lines import extract_lines
from runs.cli_locate import locate_image
from runs.cli_map import map_app
from runs.cli_session import session_app
from runs.cli_simulate import simulate
from runs.cli_sweep import sweep
from runs.logdetail import LogDetail
from runs.options import JointsOption, MapOption, RobotOption, TopicOption, numbers
from runs.palette import TRACKS
from runs.progress import progress_bar

if TYPE_CHECKING:
    from runs.session import Session

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
app.add_typer(session_app, name="session")
app.command("lines")(extract_lines)
app.command("locate")(locate_image)
app.command("calibrate")(calibrate_camera)
app.command("calibrate-robot")(calibrate_robot_command)
app.command("view")(view_run)
app.command("compare")(compare_runs)
app.command("simulate")(simulate)
app.command("sweep")(sweep)


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
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="Session folder, or a ROS bag.")],
    map_: MapOption = None,
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
    log: Annotated[
        LogDetail, typer.Option(help="What is recorded: all, all but pictures and lines, nothing.")
    ] = LogDetail.FULL,
    view: Annotated[bool, typer.Option("--view", help="Watch the run in a viewer while it goes.")] = False,
    connect: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Watch it in a rerun viewer that is open already.")
    ] = None,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write the results as run.mcap too, for ROS tools.")
    ] = False,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Run a whole navigation session: table, run folder, recording."""
    from runs.config import RunConfig, read_config
    from runs.navigation import Watching, navigate
    from runs.opening import open_session, reading_of
    from runs.results import default_folder, point_latest

    parameters = read_config(config) if config else RunConfig()
    reading = reading_of(map_, robot, topic, joints)
    drive = _started(open_session(session, reading), initial_pose, initial_std, lost)
    folder = out or default_folder(drive.name, datetime.now())
    watching = Watching(log, _viewer(view, connect), mcap)
    with progress_bar(drive.name) as progress:
        navigation = navigate(drive, parameters, folder, progress, watching)
    if out is None:
        point_latest(folder)
    _print_result(navigation.metrics, folder)
    if not navigation.usable:
        typer.echo("wireloc: no fix was accepted", err=True)
        raise typer.Exit(1)


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where robot.yaml and map.yaml go.")],
) -> None:
    """Write a robot.yaml and a map.yaml of a small room, to edit."""
    from runs.templates import write_templates

    for path in write_templates(folder):
        typer.echo(str(path))


def _viewer(view: bool, connect: str | None) -> str | None:
    """Return the URL of the viewer that is to show the run, opening one if it is to be new."""
    from runs.viewer import start_viewer, viewer_url

    if connect is not None:
        if view:
            raise InputError("--connect", "", "is another viewer than that of --view")
        return viewer_url(connect)
    return start_viewer() if view else None


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


def _print_result(metrics: dict[str, Any], folder: Path) -> None:
    """Print the table, the fixes, and where to find more."""
    console = Console()
    vision = metrics["vision"]
    if vision["wrong"] is None:
        console.print("no ground truth: errors are not known")
    else:
        errors = ((label, metrics.get(name)) for name, (_, label) in TRACKS.items())
        console.print(
            error_table(
                (label, of["position_error_m"], of["heading_error_deg"]) for label, of in errors if of
            )
        )
    wrong = "" if vision["wrong"] is None else f", {vision['wrong']} wrong"
    console.print(
        f"{vision['attempted']} looks: {vision['fixes']} fixes, {vision['partial']} partial; "
        f"{vision['accepted']} accepted, {vision['rejected']} rejected{wrong}",
        highlight=False,
    )
    console.print(str(folder), soft_wrap=True, highlight=False, markup=False)
    if (folder / "run.rrd").exists():
        console.print(f"wireloc view {folder}", soft_wrap=True, highlight=False, markup=False)
