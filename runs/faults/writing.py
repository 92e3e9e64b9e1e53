"""A corrupted recording as a session folder again; what the fault did not touch is copied byte for byte."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path

import yaml

from maps.errors import InputError
from maps.mapdocument import write_map
from runs.bags.folder import copy_beside, robot_text, write_fixes, write_odometry
from runs.faults.recording import Edit, Recording
from runs.opening import is_session_folder
from runs.results import StagedFolder, seconds
from runs.session import Frame, Session
from runs.simulation.sessionfolder import write_rows
from runs.video import SUFFIXES as VIDEOS
from vision.encoding import jpeg
from vision.rawimages import kept_file

#: Called with how many pictures are written, and of how many.
Progress = Callable[[int, int], None]
#: High enough that the compression is not the fault.
_QUALITY = 95
_REWRITTEN = ("odometry.csv", "frames.csv", "fixes.csv", "map.yaml", "fault.yaml")


def write_recording(
    original: Recording, changed: Recording, out: Path, told: object, progress: Progress
) -> None:
    """Write a session folder, whole or not at all; `told` goes into its fault.yaml, which nothing reads.

    InputError where a picture to be edited cannot be read, or `out` holds something already.
    """
    before, after = original.session, changed.session
    with StagedFolder(out) as folder:
        _copy_beside(before, folder)
        if changed.document is not None and changed.document is not original.document:
            write_map(folder / "map.yaml", changed.document)
        _write_rows(folder / "odometry.csv", before, after, after.odometry is before.odometry, write_odometry)
        if after.fixes:
            _write_rows(folder / "fixes.csv", before, after, after.fixes is before.fixes, write_fixes)
        if after.frames:
            names = _write_pictures(folder, changed, progress)
            _write_frames(folder / "frames.csv", after.frames, names, after.robot.time_offset_ns)
        (folder / "fault.yaml").write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")


def _copy_beside(session: Session, folder: Path) -> None:
    """Copy what no fault is done to, and the map; of what is no session folder, what its folder would have."""
    copy_beside(session, folder)
    if not is_session_folder(session.folder):
        (folder / "robot.yaml").write_text(robot_text(session.robot), encoding="utf-8")
        return
    # A video's frames become pictures.
    filmed = VIDEOS if any(frame.picture is not None for frame in session.frames) else ()
    for path in sorted(session.folder.iterdir()):
        if path.is_file() and path.name not in _REWRITTEN and path.suffix.lower() not in filmed:
            shutil.copyfile(path, folder / path.name)


def _write_rows(
    place: Path, before: Session, after: Session, same: bool, write: Callable[[Path, Session], None]
) -> None:
    """Copy a table of the session where it is the same, or write it."""
    known = before.folder / place.name
    if same and known.is_file():
        shutil.copyfile(known, place)
    else:
        write(place, after)


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
            place.write_bytes(_kept(frame))
        return name
    try:
        picture = frame.image()
    except InputError:
        # A picture that nobody can read is none the better for a fault.
        place.write_bytes(_kept(frame))
        return name
    place.write_bytes(jpeg(edit(picture), _QUALITY))
    return name


def _kept(frame: Frame) -> bytes:
    """Return a picture as a file's bytes: a file's own, or of raw pixels those that a folder is given."""
    return frame.data() if frame.picture is None else kept_file(frame.data())


def _write_frames(path: Path, frames: Iterable[Frame], names: list[str], offset_ns: int) -> None:
    """Write stamps as the camera's own clock has them, and arrivals."""
    rows = []
    for frame, name in zip(frames, names, strict=True):
        stamp_ns = frame.stamp_ns - offset_ns
        rows.append((seconds(stamp_ns), name, seconds(max(frame.arrival_ns, stamp_ns))))
    write_rows(path, ("timestamp_s", "filename", "arrival_s"), rows)
