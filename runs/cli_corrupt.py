"""The command line's `session corrupt` command; what it needs is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runs.options import JointsOption, MapOption, OtherMapOption, RobotOption, TopicOption
from runs.progress import progress_bar


def corrupt_session(
    session: Annotated[
        Path, typer.Argument(metavar="SESSION", help="Session folder, bag, or another layout.")
    ],
    *,
    fault: Annotated[str, typer.Option(metavar="KIND", help="What goes wrong; `list` shows the kinds.")],
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Session folder to write.")] = None,
    map_: MapOption = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same fault.")] = 0,
    at: Annotated[
        float | None, typer.Option(metavar="S", min=0.0, help="When it begins, from the first event on.")
    ] = None,
    for_: Annotated[
        float | None, typer.Option("--for", metavar="S", min=0.02, help="How long it holds.")
    ] = None,
    other_map: OtherMapOption = None,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Write a copy of a session, as a session folder, in which something goes wrong."""
    from maps.errors import InputError
    from runs.faults.kinds import FAULTS, chosen_fault, corrupted, fault_span, told_of
    from runs.faults.recording import read_recording
    from runs.faults.simulating import read_other
    from runs.faults.writing import write_recording
    from runs.opening import reading_of

    if fault == "list":
        for name, one in FAULTS.items():
            typer.echo(f"{name:<18} {one.about}")
        return
    chosen = chosen_fault(fault)
    if out is None:
        raise InputError("--out", "", "missing: no folder to write")
    other = read_other((fault,), other_map)
    recording = read_recording(session, reading_of(map_, robot, topic, joints))
    span = fault_span(recording, chosen, at, for_)
    told = told_of(fault, seed, span)
    with progress_bar(out.name) as progress:
        write_recording(recording, corrupted(recording, fault, span, seed, other), out, told, progress)
    typer.echo(str(out))
