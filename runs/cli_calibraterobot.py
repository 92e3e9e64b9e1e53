"""The command line's `calibrate-robot` command; what it needs is imported when it runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from runs.options import JointsOption, MapOption, RobotOption, TopicOption
from runs.progress import progress_bar

if TYPE_CHECKING:
    from runs.robotcalibration import RobotCalibration


def calibrate_robot_command(
    session: Annotated[
        Path, typer.Argument(metavar="SESSION", help="Session folder, bag, or another layout, with images.")
    ],
    *,
    map_: MapOption = None,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="robot.yaml to write: the session's with what was found.")
    ],
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameters that differ (YAML).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Calibrate wheels, camera mount and time offset from one drive; ends with 1 where it does not suffice."""
    from maps.documents import checked, read_yaml
    from maps.errors import InputError
    from maps.mapdocument import write_whole
    from runs.bags.folder import robot_text
    from runs.opening import open_session, reading_of
    from runs.robotcalibration import RobotCalibrationConfig, Uncalibrated, calibrate_robot, content_of
    from runs.robotparameters import with_parameters

    parameters = RobotCalibrationConfig()
    if config is not None:
        parameters = checked(RobotCalibrationConfig, read_yaml(config), config)
    if not out.absolute().parent.is_dir():
        # Told before the work, not after.
        raise InputError(out, "", "no such folder to write it to")
    drive = open_session(session, reading_of(map_, robot, topic, joints))
    with progress_bar(drive.name) as progress:
        result = calibrate_robot(drive, parameters, progress)
    if as_json:
        typer.echo(json.dumps(content_of(result), indent=2))
    if isinstance(result, Uncalibrated):
        typer.echo(f"wireloc: not calibrated: {result.why}", err=True)
        raise typer.Exit(1)
    # Where this drive began is the bag's to say, not the robot's.
    text = robot_text(replace(drive.robot, start=None))
    write_whole(out, with_parameters(text, drive.robot.path, result.found, result.deviations).encode())
    if not as_json:
        _print(result)
        typer.echo(str(out))


def _print(result: RobotCalibration) -> None:
    """Print the table, and what it rests on."""
    from runs.robotparameters import shown_value

    console = Console()
    if not console.is_terminal:
        console.width = 10_000
    table = Table("parameter", "prior", "std before", "estimate", "std", "", box=SIMPLE_HEAD)
    for column in table.columns[1:5]:
        column.justify = "right"
    columns = (
        result.names,
        result.prior.values,
        result.prior.std,
        result.estimates,
        result.std,
        result.shown,
    )
    for name, *values, shown in zip(*columns, strict=True):
        told = [shown_value(name, float(value)) for value in values]
        table.add_row(name, *told, "shown" if shown else "not shown")
    console.print(table)
    hidden = [name for name, shown in zip(result.names, result.shown, strict=True) if not shown]
    if hidden:
        console.print(f"not shown by this drive, and kept: {', '.join(hidden)}", highlight=False)
    console.print(
        f"{result.frames} of {result.offered} frames, {result.lines} lines; errors over what was expected: "
        + ", ".join(f"{name} {spread:.2f}" for name, spread in result.spreads.items()),
        highlight=False,
    )
