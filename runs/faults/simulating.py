"""Simulated sessions in which something goes wrong: on the drive itself, or in what was recorded of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from maps.errors import InputError
from maps.mapdocument import MapDocument, read_document
from maps.mapfile import read_map
from runs.faults.kinds import (
    WRONG_MAP,
    check_possible,
    chosen_fault,
    corrupted,
    fault_rng,
    fault_span,
    told_of,
)
from runs.faults.recording import Recording, Span, read_recording
from runs.faults.writing import write_recording
from runs.results import StagedFolder
from runs.simulation.rehearsal import Recipe, rehearsed
from runs.simulation.sessionfolder import simulate_folder

#: Called with how many frames are drawn, and of how many.
Progress = Callable[[int, int], None]
FILE = "fault.yaml"


@dataclass(frozen=True, slots=True)
class Troubles:
    """Faults by name, one after the other; `at_s`, `for_s` as in `fault_span`; `other_map`: the wrong map's file."""

    kinds: tuple[str, ...]
    at_s: float | None = None
    for_s: float | None = None
    other_map: Path | None = None


def simulate_faulty(
    out: Path, map_path: Path, robot_path: Path, recipe: Recipe, troubles: Troubles, progress: Progress
) -> None:
    """Simulate a session folder with faults, or none, whole or not at all.

    Faults that happen on the drive are simulated with it, the others done to the session; all draw from the recipe's
    seed what `wireloc session corrupt` draws from it. InputError as for `simulate_folder`, and for faults.
    """
    # Told before an hour of pictures, not after it.
    StagedFolder(out)
    other = read_other(troubles.kinds, troubles.other_map)
    session = rehearsed(map_path, robot_path, recipe).session(out)
    recording = Recording(session, (None,) * len(session.frames), read_document(map_path))
    spans = [
        fault_span(recording, chosen_fault(kind), troubles.at_s, troubles.for_s) for kind in troubles.kinds
    ]
    mishaps, later = recipe.mishaps, list[tuple[str, Span]]()
    for kind, span in zip(troubles.kinds, spans, strict=True):
        happening = chosen_fault(kind).happening
        check_possible(recording, kind)
        if happening is not None:
            mishaps = happening(mishaps, span, fault_rng(kind, recipe.seed))
        else:
            recording = corrupted(recording, kind, span, recipe.seed, other)
            later.append((kind, span))
    told: list[object] = [
        told_of(kind, recipe.seed, span) for kind, span in zip(troubles.kinds, spans, strict=True)
    ]
    notes = {FILE: told[0] if len(told) == 1 else told} if told else {}
    recipe = replace(recipe, mishaps=mishaps)
    with TemporaryDirectory() as scratch:
        places = [*(Path(scratch) / f"{number}" / out.name for number in range(len(later))), out]
        simulate_folder(places[0], map_path, robot_path, recipe, progress, notes)
        for (kind, span), before, after in zip(later, places[:-1], places[1:], strict=True):
            original = read_recording(before)
            changed = corrupted(original, kind, span, recipe.seed, other)
            write_recording(original, changed, after, notes[FILE], _nobody)


def read_other(kinds: Sequence[str], path: Path | None) -> MapDocument | None:
    """Read the wrong map; InputError where it cannot be read, or nobody asked for a wrong map."""
    if path is None:
        return None
    if WRONG_MAP not in kinds:
        raise InputError("--other-map", "", f"is for --fault {WRONG_MAP}")
    read_map(path)
    return read_document(path)


def _nobody(done: int, total: int) -> None:
    """Tell nobody how far it is."""
