"""A corrupted recording as a session folder again; what the fault did not touch is copied byte for byte."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from maps.errors import InputError
from maps.mapdocument import write_map
from runs.faults.recording import Edit, Recording
from runs.results import StagedFolder, seconds
from runs.session import Frame
from runs.simulation.sessionfolder import write_fixes, write_odometry, write_rows
from vision.encoding import jpeg

#: Called with how many pictures are written, and of how many.
Progress = Callable[[int, int], None]
#: High enough that the compression is not the fault.
_QUALITY = 95
_REWRITTEN = ("odometry.csv", "frames.csv", "fixes.csv", "map.yaml", "fault.yaml")


def write_recording(
    original: Recording, changed: Recording, out: Path, told: dict[str, Any], progress: Progress
) -> None:
    """Write a session folder, whole or not at all; `told` goes into its fault.yaml, which nothing reads.

    InputError where a picture to be edited cannot be read, or `out` holds something already.
    """
    before, after = original.session, changed.session
    with StagedFolder(out) as folder:
        for path in sorted(before.folder.iterdir()):
            if path.is_file() and path.name not in _REWRITTEN:
                shutil.copyfile(path, folder / path.name)
        if after.odometry is before.odometry:
            shutil.copyfile(before.folder / "odometry.csv", folder / "odometry.csv")
        else:
            unscaled = after.odometry
            if unscaled.wheels is None:
                unscaled = replace(unscaled, values=unscaled.values / np.array(after.robot.twist_scales))
            write_odometry(folder / "odometry.csv", unscaled)
        if after.fixes is not before.fixes:
            write_fixes(folder / "fixes.csv", after.fixes)
        elif before.fixes:
            shutil.copyfile(before.folder / "fixes.csv", folder / "fixes.csv")
        if changed.document is not None and changed.document is not original.document:
            write_map(folder / "map.yaml", changed.document)
        elif before.map_path is not None:
            shutil.copyfile(before.map_path, folder / "map.yaml")
        if after.frames:
            names = _write_pictures(folder, changed, progress)
            _write_frames(folder / "frames.csv", after.frames, names, after.robot.time_offset_ns)
        (folder / "fault.yaml").write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")


def _write_pictures(folder: Path, changed: Recording, progress: Progress) -> list[str]:
    """Write every frame's picture, and return their names.

    Edited ones get names of their own: nobody has counted what can be seen in them.
    """
    frames, names = changed.session.frames, []
    taken = {Path(frame.filename).parts[0] for frame in frames}
    edited = next(name for n in count(1) if (name := f"edited{n}") not in taken)
    for number, (frame, edit) in enumerate(zip(frames, changed.edits, strict=True)):
        names.append(_write_picture(folder, f"{edited}/{number:06d}.jpg", frame, edit))
        progress(number + 1, len(frames))
    return names


def _write_picture(folder: Path, edited: str, frame: Frame, edit: Edit | None) -> str:
    name = frame.filename if edit is None else edited
    place = folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    if edit is None:
        if not place.exists():
            place.write_bytes(frame.data())
        return name
    try:
        picture = frame.image()
    except InputError:
        # A picture that nobody can read is none the better for a fault.
        place.write_bytes(frame.data())
        return name
    place.write_bytes(jpeg(edit(picture), _QUALITY))
    return name


def _write_frames(path: Path, frames: Iterable[Frame], names: list[str], offset_ns: int) -> None:
    """Write stamps as the camera's own clock has them, and arrivals."""
    rows = []
    for frame, name in zip(frames, names, strict=True):
        stamp_ns = frame.stamp_ns - offset_ns
        rows.append((seconds(stamp_ns), name, seconds(max(frame.arrival_ns, stamp_ns))))
    write_rows(path, ("timestamp_s", "filename", "arrival_s"), rows)
