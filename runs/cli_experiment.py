"""The command line's `experiment` commands; what they need is imported when they run."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from maps.errors import InputError
from runs.options import JointsOption, MapOption, RobotOption, TopicOption
from runs.progress import progress_bar

if TYPE_CHECKING:
    from maps.wiremap import WireMap
    from runs.experiments.cases import Case
    from runs.experiments.output import Report
    from runs.experiments.synthetic import SyntheticStudy

T = TypeVar("T")

#: Table 3's number of images.
IMAGES = 430
MOST_IMAGES = 100_000
#: What the synthetic images have no shorter lines than.
MIN_LENGTH_PX = 40.0
#: All methods, until somebody names some.
METHODS = "paper,default"
#: Five minutes on two cores for 430 images at the three estimates of the paper.
BUDGET = 400_000

Out = Annotated[Path, typer.Option(metavar="DIR", help="Where tables, figures and the page go.")]
Images = Annotated[int, typer.Option(min=1, max=MOST_IMAGES, metavar="N", help="Images a case.")]
Seed = Annotated[int, typer.Option(min=0, metavar="S", help="What all random draws hang on.")]
Methods = Annotated[str, typer.Option(metavar="A,B", help="Methods to compare.")]
Hall = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Map to draw images from, if not the hall of 65 edges.")
]
Workers = Annotated[int, typer.Option(min=0, metavar="N", help="Processes; 0 for as many as cores.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask cluster to work on, like tcp://host:8786.")
]
Budget = Annotated[
    int, typer.Option(min=1, metavar="N", help="Hypotheses the paper's method may evaluate an image.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures for programs.")]

experiment_app = typer.Typer(
    help="Repeat the paper's measurements, method beside method.", no_args_is_help=True
)


@experiment_app.command("synthetic")
def synthetic(
    out: Out,
    images: Images = IMAGES,
    seed: Seed = 1,
    methods: Methods = METHODS,
    cases: Annotated[
        str | None, typer.Option(metavar="A,B", help="Cases, if not all: qi1, qi2, qi3, far, global, …")
    ] = None,
    hall: Hall = None,
    budget: Budget = BUDGET,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Match synthetic images of a map: table 3, hypotheses, errors against the bound, times (section 4.1)."""
    from runs.experiments.cases import CASES, chosen_cases
    from runs.experiments.syntheticreport import synthetic_report

    chosen = chosen_cases(cases) if cases is not None else tuple(CASES.values())
    study = _study(hall, methods, budget, chosen, seed)

    def measured() -> Report:
        found = _trials(study, "synthetic images", images, workers, scheduler)
        return synthetic_report(found, chosen, images, seed)

    _write(out, measured, as_json)


@experiment_app.command("complexity")
def complexity(
    out: Out,
    images: Annotated[
        int, typer.Option(min=1, max=MOST_IMAGES, metavar="N", help="Images a number of lines.")
    ] = 100,
    seed: Seed = 1,
    methods: Methods = METHODS,
    hall: Hall = None,
    budget: Budget = BUDGET,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Count the search space of synthetic images and measure how time grows with lines (section 3.6)."""
    from runs.experiments.cases import CASES, CLUTTER_COUNTS
    from runs.experiments.complexityreport import complexity_report
    from runs.experiments.zones import ZoneStudy

    chosen = tuple(CASES[f"clutter{count}"] for count in CLUTTER_COUNTS)
    study = _study(hall, methods, budget, chosen, seed)

    def measured() -> Report:
        found = _trials(study, "search", images, workers, scheduler)
        zones = _trials(ZoneStudy(study.wire_map, chosen[0], seed), "zones", images, workers, scheduler)
        return complexity_report(found, [case.name for case in chosen], images, seed, zones)

    _write(out, measured, as_json)


@experiment_app.command("session")
def session(
    session_: Annotated[
        Path,
        typer.Argument(metavar="SESSION", help="Session folder, or a ROS 2 folder, with images and truth."),
    ],
    out: Out,
    map_: MapOption = None,
    images: Annotated[
        int, typer.Option(min=1, max=MOST_IMAGES, metavar="N", help="Frames, evenly over the session.")
    ] = 50,
    min_length: Annotated[
        float, typer.Option(min=1.0, metavar="PX", help="Shorter lines are left out, for every method.")
    ] = MIN_LENGTH_PX,
    seed: Seed = 1,
    methods: Methods = METHODS,
    budget: Budget = BUDGET,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Match a session's frames one by one, from estimates of QI 3 about the truth: table 4 (section 4.2)."""
    from runs.config import RunConfig
    from runs.experiments.methods import Setting, chosen_methods
    from runs.experiments.recorded import session_study
    from runs.experiments.recordedreport import session_report
    from runs.opening import open_session, reading_of

    drive = open_session(session_, reading_of(map_, robot, topic, joints))
    if drive.camera is None or drive.wire_map is None:
        raise InputError(session_, "", "no images to match")
    setting = Setting(drive.camera.mount.height_m, drawn=False, budget=budget)
    chosen = chosen_methods(methods, drive.wire_map, setting)
    lines = replace(RunConfig().matcher.lines, min_length_px=min_length)
    study = session_study(drive, chosen, lines, images, seed)

    def measured() -> Report:
        found = _trials(study, drive.name, len(study.frames), workers, scheduler)
        return session_report(found, drive.name, seed)

    _write(out, measured, as_json)


def _study(
    hall: Path | None, methods: str, budget: int, cases: tuple[Case, ...], seed: int
) -> SyntheticStudy:
    """A study of images drawn from the hall, or from the map that is named."""
    from runs.experiments.methods import Setting, chosen_methods
    from runs.experiments.synthetic import SyntheticStudy
    from runs.experiments.syntheticimage import CAMERA_HEIGHT_M, exactly_known, standing_room

    wire_map = exactly_known(_hall(hall))
    standing_room(wire_map)
    setting = Setting(CAMERA_HEIGHT_M, drawn=True, budget=budget)
    return SyntheticStudy(wire_map, chosen_methods(methods, wire_map, setting), cases, seed)


def _trials(
    study: Callable[[int], list[T]], name: str, count: int, workers: int, scheduler: str | None
) -> list[T]:
    """Run trials with a progress bar, on as many processes as asked for or as there are cores."""
    from runs.experiments.trials import run_trials

    with progress_bar(name) as progress:
        found = run_trials(study, count, progress, workers or os.cpu_count() or 1, scheduler)
    return [trial for trials in found for trial in trials]


def _hall(path: Path | None) -> WireMap:
    if path is not None:
        from maps.mapfile import read_map

        return read_map(path)
    from runs.experiments.hall import hall_map

    return hall_map()


def _write(out: Path, measured: Callable[[], Report], as_json: bool) -> None:
    """Measure, write the folder whole or not at all, and say what was found."""
    from runs.results import StagedFolder

    with StagedFolder(out) as folder:
        report = measured()
        report.write(folder)
    if as_json:
        typer.echo(json.dumps(report.content, indent=1))
        return
    console = Console()
    if not console.is_terminal:
        console.width = 10_000
    for grid in report.grids:
        table = Table(title=grid.title, title_justify="left", box=SIMPLE_HEAD)
        for number, name in enumerate(grid.header):
            table.add_column(Text(name), justify="right" if number > 1 else "left")
        for row in grid.rows:
            table.add_row(*map(Text, row))
        console.print(table)
        if grid.remark:
            console.print(Text(grid.remark), style="dim")
            console.print()
    console.print(str(out), soft_wrap=True, highlight=False, markup=False)
