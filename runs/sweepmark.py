"""What a sweep's result hangs on: the item, the files that it reads, and the program itself, as one digest.

Tables, maps and parameters count by what they say; pictures, bags and videos, which are large, by name, size and
when they were changed.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from runs.config import LIBRARIES
from runs.session import find_map

if TYPE_CHECKING:
    from runs.sweep import Item

#: The packages whose source decides what a run finds.
_PACKAGES = ("maps", "vision", "localization", "runs")
#: What is read whole.
_TEXTS = (".csv", ".txt", ".yaml", ".yml")


class Marks:
    """Marks of items; a drive that many items share is looked at once."""

    def __init__(self) -> None:
        """Know of no drive yet."""
        self._drives: dict[str, str] = {}

    def of(self, item: Item) -> str:
        """Return an item's mark; OSError where a file cannot be read."""
        if item.session not in self._drives:
            self._drives[item.session] = _drive_digest(Path(item.session))
        told = [_program(), self._drives[item.session], json.dumps(asdict(item), sort_keys=True)]
        named = (item.map_path, item.robot_path, item.config)
        told += [_digest(Path(name).read_bytes()) for name in named if name]
        return _digest("\n".join(told).encode())


def _drive_digest(drive: Path) -> str:
    """Return what changes with the files of a drive, and with the map and the robot beside it."""
    beside = [drive.parent / "robot.yaml", *([found] if (found := find_map(drive)) else [])]
    told = [
        (os.path.relpath(path, drive), *_file(path))
        for path in [*_files(drive), *(path for path in beside if path.is_file())]
    ]
    return _digest(repr(sorted(told)).encode())


def _file(path: Path) -> tuple[str, int]:
    """Return what tells a file from what it was: its content's digest, or its size and time."""
    if path.suffix in _TEXTS:
        return _digest(path.read_bytes()), 0
    known = path.stat()
    return str(known.st_size), known.st_mtime_ns


def _files(drive: Path) -> Iterator[Path]:
    """Yield the files of a drive, also behind links, each folder once."""
    if not drive.is_dir():
        yield drive
        return
    seen: set[str] = set()
    for place, folders, names in os.walk(drive, followlinks=True):
        seen.add(os.path.realpath(place))
        folders[:] = [name for name in folders if os.path.realpath(os.path.join(place, name)) not in seen]
        yield from (Path(place) / name for name in names)


@cache
def _program() -> str:
    """Return what changes with this program's source, or with a library whose numbers results depend on."""
    told = [f"{name} {version(name)}" for name in LIBRARIES]
    for package in _PACKAGES:
        folder = Path(str(import_module(package).__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            told.append(f"{package}/{path.relative_to(folder)} {_digest(path.read_bytes())}")
    return _digest("\n".join(told).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
