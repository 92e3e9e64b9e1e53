"""The command line's `session` commands; what they need is imported when they run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from maps.errors import InputError
from runs.cli_corrupt import corrupt_session
from runs.options import JointsOption, MapOption, RobotOption, TopicOption
from runs.progress import progress_bar

if TYPE_CHECKING:
    from runs.bags.bagfile import BagKind
    from runs.bags.listing import TopicUse

session_app = typer.Typer(
    help="Recorded drives: what is in them, and other forms of them.", no_args_is_help=True
)
session_app.command("corrupt")(corrupt_session)


@session_app.command("topics")
def list_topics(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="ROS 2 folder, .mcap, .db3, or ROS 1 .bag.")],
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """List a bag's topics, and which of them would be read for what."""
    from runs.bags.listing import topic_uses
    from runs.opening import refuse_folder, wanted_topics

    refuse_folder(bag)
    uses, open_question = topic_uses(bag, robot, wanted_topics(topic or [], joints))
    if as_json:
        rows = [use.as_json() for use in uses]
        typer.echo(json.dumps({"topics": rows, "open": open_question}, indent=2))
        return
    _print_topics(uses)
    if open_question:
        typer.echo(f"wireloc: {open_question}", err=True)


@session_app.command("convert")
def convert(
    source: Annotated[Path, typer.Argument(metavar="SESSION|BAG", help="What to convert.")],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="TARGET",
            help="Of a bag or another layout: a session folder; of a session: a ROS 2 folder, .mcap, .db3, .bag.",
        ),
    ],
    map_: MapOption = None,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
    storage: Annotated[
        str | None, typer.Option(metavar="mcap|sqlite3", help="Storage of a ROS 2 folder; mcap unless told.")
    ] = None,
) -> None:
    """Turn a bag, or an EuRoC or TUM RGB-D folder, into a session folder; or a session folder into a bag."""
    from runs.bags.folder import write_folder
    from runs.bags.opening import is_bag
    from runs.bags.writing import write_bag
    from runs.layouts import is_layout
    from runs.opening import open_session, reading_of

    kind = _kind(source, target, is_bag(source), storage, is_bag(source) or is_layout(source))
    session = open_session(source, reading_of(map_, robot, topic, joints))
    with progress_bar(target.name) as progress:
        if kind is None:
            write_folder(session, target, progress)
        else:
            write_bag(session, target, kind, progress)
    typer.echo(str(target))
    if kind is not None and target.is_file():
        typer.echo(
            "robot.yaml and map.yaml are not in it: keep them beside it, or name them with --robot and --map"
        )


def _kind(source: Path, target: Path, from_bag: bool, storage: str | None, foreign: bool) -> BagKind | None:
    """Return the kind of bag to write, None for a session folder."""
    from runs.bags.bagfile import BagKind

    files = {".bag": BagKind.ROS1, ".mcap": BagKind.MCAP, ".db3": BagKind.SQLITE3}
    folders = {None: BagKind.MCAP, "mcap": BagKind.MCAP, "sqlite3": BagKind.SQLITE3}
    if storage not in folders:
        raise InputError("--storage", "", f"expected mcap or sqlite3, not {storage!r}")
    if target.suffix in files or not foreign:
        if from_bag:
            raise InputError(target, "", f"{source} is a bag already; the target is to be a session folder")
        if target.suffix in files and storage is not None:
            raise InputError("--storage", "", f"{target.suffix} says it already")
        return files.get(target.suffix, folders[storage])
    if storage is not None:
        raise InputError("--storage", "", "says nothing where the target is a session folder")
    return None


def _print_topics(uses: tuple[TopicUse, ...]) -> None:
    table = Table("topic", "type", "messages", "could be", "is read as", box=None, pad_edge=False)
    for use in uses:
        table.add_row(use.name, use.msgtype, str(use.count), ", ".join(use.roles), use.use)
    Console().print(table, soft_wrap=True, highlight=False)
