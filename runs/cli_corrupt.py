"""The command line's `session corrupt` command; what it needs is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runs.progress import progress_bar


def corrupt_session(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="Session folder.")],
    *,
    fault: Annotated[str, typer.Option(metavar="KIND", help="What goes wrong; `list` shows the kinds.")],
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Session folder to write.")] = None,
    map_: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map, if not the session's.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same fault.")] = 0,
    at: Annotated[
        float | None, typer.Option(metavar="S", min=0.0, help="When it begins, from the first event on.")
    ] = None,
    for_: Annotated[
        float | None, typer.Option("--for", metavar="S", min=0.02, help="How long it holds.")
    ] = None,
) -> None:
    """Write a copy of a session in which something goes wrong."""
    from maps.errors import InputError
    from runs.faults.kinds import FAULTS, chosen_fault, corrupted, fault_span
    from runs.faults.recording import read_recording
    from runs.faults.writing import write_recording

    if fault == "list":
        for name, one in FAULTS.items():
            typer.echo(f"{name:<18} {one.about}")
        return
    chosen = chosen_fault(fault)
    if out is None:
        raise InputError("--out", "", "missing: no folder to write")
    recording = read_recording(session, map_)
    span = fault_span(recording, chosen, at, for_)
    told = {"kind": fault, "seed": seed, "start_s": span.start_ns / 1e9, "end_s": span.end_ns / 1e9}
    with progress_bar(out.name) as progress:
        write_recording(recording, corrupted(recording, fault, span, seed), out, told, progress)
    typer.echo(str(out))
