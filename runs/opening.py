"""Whatever holds a drive, opened as a session: a folder, a bag, other projects' layouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from maps.errors import InputError
from runs.bags.opening import is_bag
from runs.bags.topics import Role, Wanted
from runs.layouts import is_layout, read_layout
from runs.session import Session, read_session


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read what is no session folder: its map and its robot.yaml, and which topics of a bag to use."""

    map_path: Path | None = None
    robot_path: Path | None = None
    wanted: Wanted = field(default_factory=Wanted)


def open_session(path: Path, reading: Reading | None = None) -> Session:
    """Open a drive; InputError names the file, and the key, line or topic, of what is missing or cannot be."""
    reading = reading or Reading()
    if is_bag(path):
        from runs.bags.reading import read_bag

        return read_bag(path, reading.map_path, reading.robot_path, reading.wanted)
    foreign = path.is_dir() and is_layout(path)
    for option, given in (
        ("--robot", reading.robot_path and not foreign),
        ("--topic", reading.wanted.topics),
        ("--joints", reading.wanted.joints),
    ):
        if given:
            raise InputError(
                option, "", f"is for bags, and {path} is a {'' if foreign else 'session '}folder"
            )
    if foreign:
        return read_layout(path, reading.map_path, reading.robot_path)
    return read_session(path, reading.map_path)


def is_session_folder(path: Path) -> bool:
    """Whether a drive lies in this project's own files: nothing of it has to be made of something else."""
    return path.is_dir() and not is_bag(path) and not is_layout(path)


def refuse_folder(path: Path) -> None:
    """Raise InputError where a drive has tables instead of topics."""
    if path.is_dir() and not is_bag(path) and (is_layout(path) or (path / "odometry.csv").exists()):
        raise InputError(path, "", "a folder with tables, not a bag with topics: it needs no choice of any")


def reading_of(
    map_path: Path | None, robot_path: Path | None, topics: Sequence[str] | None, joints: str | None
) -> Reading:
    """Return what the options of a command ask for; InputError where one is not of its form."""
    return Reading(map_path, robot_path, wanted_topics(topics or (), joints))


def wanted_topics(topics: Sequence[str], joints: str | None) -> Wanted:
    """Return what `--topic ROLE=TOPIC` and `--joints LEFT,RIGHT` ask for; InputError where it is not their form."""
    chosen: dict[Role, str] = {}
    for text in topics:
        role, _, name = text.partition("=")
        if role not in list(Role) or not name:
            raise InputError(
                "--topic", "", f"expected ROLE=TOPIC with a role of {', '.join(Role)}, not {text!r}"
            )
        chosen[Role(role)] = name
    if joints is None:
        return Wanted(chosen)
    left, _, right = joints.partition(",")
    if not left or not right or left == right:
        raise InputError("--joints", "", f"expected LEFT,RIGHT, not {joints!r}")
    return Wanted(chosen, (left, right))
