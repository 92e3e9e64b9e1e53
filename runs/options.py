"""Options that several commands share: where a drive's map and robot are, and those that hold several numbers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from maps.errors import InputError

MapOption = Annotated[Path | None, typer.Option("--map", metavar="FILE", help="Map, if not the session's.")]
OtherMapOption = Annotated[
    Path | None,
    typer.Option("--other-map", metavar="FILE", help="Another building's, for the fault wrong-map."),
]
RobotOption = Annotated[
    Path | None,
    typer.Option(
        "--robot", metavar="FILE", help="robot.yaml, if not beside the bag.", rich_help_panel="Bags"
    ),
]
TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="ROLE=TOPIC",
        help="Topic of a bag for a role: image, info, odometry, start, fixes.",
        rich_help_panel="Bags",
    ),
]
JointsOption = Annotated[
    str | None,
    typer.Option(
        "--joints", metavar="LEFT,RIGHT", help="The wheels' joints in a bag.", rich_help_panel="Bags"
    ),
]


def numbers(option: str, text: str, form: str, counts: tuple[int, ...]) -> list[float]:
    """Return the numbers of an option such as 1.5,2,0.3; InputError tells the form that was expected."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(math.isfinite(value) for value in values):
        raise InputError(option, "", f"expected {form} in numbers, not {text!r}")
    return values
