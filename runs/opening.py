"""Whatever holds a drive, opened as a session: a folder, a bag, other projects' layouts."""

from __future__ import annotations

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
    if is_layout(path):
        return read_layout(path, reading.map_path)
    for option, given in (
        ("--robot", reading.robot_path),
        ("--topic", reading.wanted.topics),
        ("--joints", reading.wanted.joints),
    ):
        if given:
            raise InputError(option, "", f"is for bags, and {path} is a session folder")
    return read_session(path, reading.map_path)


def wanted_topics(topics: list[str], joints: str | None) -> Wanted:
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
