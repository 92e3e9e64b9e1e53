"""The command line's `simulate` command; what it needs is imported when it runs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runs.options import OtherMapOption
from runs.progress import progress_bar

_SAMPLE = Path(__file__).parent / "samples" / "building_a"


class Calibration(StrEnum):
    """How far the robot may be from its file."""

    EXACT = "exact"
    CALIBRATED = "calibrated"
    UNCALIBRATED = "uncalibrated"


def simulate(
    map_: Annotated[Path | None, typer.Argument(metavar="MAP", help="Map; the sample's without one.")] = None,
    *,
    out: Annotated[Path, typer.Option(metavar="SESSION", help="Session folder to write.")],
    robot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="robot.yaml; the sample's without one.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same session.")] = 0,
    seconds: Annotated[float, typer.Option(min=1.0, max=36000.0, help="How long the robot drives.")] = 60.0,
    frame_rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", min=0.0, max=100.0, help="Images a second; 1, or 0 with --fixes."),
    ] = None,
    fixes: Annotated[bool, typer.Option("--fixes", help="Write recorded fixes, one a second.")] = False,
    outliers: Annotated[
        float, typer.Option(metavar="SHARE", min=0.0, max=1.0, help="Gross outliers among the fixes.")
    ] = 0.0,
    twist: Annotated[bool, typer.Option("--twist", help="Odometry as speeds, not wheel angles.")] = False,
    calibration: Annotated[
        Calibration, typer.Option(help="How far the robot may be from its file.")
    ] = Calibration.CALIBRATED,
    light: Annotated[
        float, typer.Option(min=0.05, max=10.0, help="Lamps; 1 is a usual evening, less is noisier.")
    ] = 1.0,
    clutter: Annotated[
        float, typer.Option(min=0.0, max=5.0, help="What the map lacks: furniture, people, posters.")
    ] = 1.0,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND", help="What goes wrong, as in `session corrupt`; may be repeated."),
    ] = None,
    at: Annotated[
        float | None, typer.Option(metavar="S", min=0.0, help="When a fault begins, from the first event on.")
    ] = None,
    for_: Annotated[
        float | None, typer.Option("--for", metavar="S", min=0.02, help="How long it holds.")
    ] = None,
    other_map: OtherMapOption = None,
) -> None:
    """Simulate a drive through a building: a session folder with odometry, images or fixes, and the truth."""
    from runs.faults.simulating import Troubles, simulate_faulty
    from runs.simulation.clutter import scaled
    from runs.simulation.fixes import FixErrors
    from runs.simulation.offsets import CALIBRATED, UNCALIBRATED, Offsets
    from runs.simulation.rehearsal import Recipe
    from runs.simulation.scene import Conditions
    from runs.simulation.wheels import TwistErrors, WheelErrors

    offsets = {
        Calibration.EXACT: Offsets(),
        Calibration.CALIBRATED: CALIBRATED,
        Calibration.UNCALIBRATED: UNCALIBRATED,
    }
    if frame_rate is None:
        frame_rate = 0.0 if fixes else 1.0
    recipe = Recipe(
        seed=seed,
        seconds=seconds,
        odometry=TwistErrors() if twist else WheelErrors(),
        offsets=offsets[calibration],
        frame_rate_hz=frame_rate,
        conditions=Conditions(light=light, sun=seed % 2 == 0, clutter=scaled(clutter)),
        fixes=FixErrors(outlier_share=outliers) if fixes else None,
    )
    with progress_bar(out.name) as progress:
        troubles = Troubles(tuple(fault or ()), at, for_, other_map)
        building, driven = map_ or _SAMPLE / "map.yaml", robot or _SAMPLE / "robot.yaml"
        simulate_faulty(out, building, driven, recipe, troubles, progress)
    typer.echo(str(out))
