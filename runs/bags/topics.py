"""Which topics of a bag tell what: guessed where only one fits, else to be chosen."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from maps.errors import InputError
from runs.bags.opening import told

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


class Role(StrEnum):
    """What a topic is read for; the values are those of `--topic ROLE=TOPIC`."""

    IMAGE = "image"
    INFO = "info"
    ODOMETRY = "odometry"
    START = "start"
    FIXES = "fixes"


IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
JOINTS = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

TYPES = {
    Role.IMAGE: IMAGES,
    Role.INFO: (CAMERA_INFO,),
    Role.ODOMETRY: (ODOMETRY, JOINTS),
    Role.START: (POSE,),
    Role.FIXES: (POSE,),
}

#: Images that are no pictures.
_NO_PICTURE = re.compile(r"depth|disparity|mask|segment|label", re.IGNORECASE)
_START = re.compile(r"initial_?pose$", re.IGNORECASE)
_FIXES = re.compile(r"(^|/)fixes$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What was asked for: topics by their role, and the names of the wheels' joints, left and right."""

    topics: Mapping[Role, str] = field(default_factory=dict)
    joints: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """One topic of a bag; `roles` are those that its type and its name allow."""

    name: str
    msgtype: str
    count: int
    connections: tuple[Connection, ...]
    roles: tuple[Role, ...]


def listed(bag: Path, reader: AnyReader) -> tuple[Topic, ...]:
    """Return an open bag's topics by name, one with several types once for each; InputError where it is damaged."""
    grouped: dict[tuple[str, str], list[Connection]] = {}
    with told(bag):
        for connection in reader.connections:
            grouped.setdefault((connection.topic, connection.msgtype), []).append(connection)
        return tuple(
            Topic(name, kind, sum(of.msgcount for of in group), tuple(group), _roles(name, kind))
            for (name, kind), group in sorted(grouped.items())
        )


def transforms(topics: tuple[Topic, ...]) -> list[Topic]:
    """Return the topics with transforms, those of /tf_static first."""
    found = [topic for topic in topics if topic.msgtype in TRANSFORMS and topic.count]
    return sorted(found, key=lambda topic: not topic.name.endswith("tf_static"))


def choose(path: Path, topics: tuple[Topic, ...], wanted: Wanted, by_wheels: bool) -> dict[Role, Topic]:
    """Return the topic for every role that has one; InputError where several fit and none was named.

    `by_wheels`: whether the robot's wheels are known, so that their angles are of use.
    """
    found: dict[Role, Topic] = {}
    for role in Role:
        named = wanted.topics.get(role)
        fitting = _named(path, topics, role, named) if named else _guessed(topics, role, found, by_wheels)
        if len(fitting) > 1:
            names = ", ".join(topic.name for topic in fitting)
            raise InputError(path, "", f"several topics fit {role}: {names}; name one with --topic {role}=")
        if fitting:
            found[role] = fitting[0]
    return found


def _named(path: Path, topics: tuple[Topic, ...], role: Role, name: str) -> list[Topic]:
    fitting = [topic for topic in topics if topic.name == name and topic.msgtype in TYPES[role]]
    if not fitting:
        there = any(topic.name == name for topic in topics)
        kinds = " or ".join(kind.rpartition("/")[2] for kind in TYPES[role])
        what = f"{name} is no {kinds}" if there else f"no topic {name}"
        raise InputError(path, f"--topic {role}", what)
    return fitting


def _guessed(
    topics: tuple[Topic, ...], role: Role, found: Mapping[Role, Topic], by_wheels: bool
) -> list[Topic]:
    fitting = [topic for topic in topics if role in topic.roles and topic.count]
    match role:
        case Role.IMAGE:
            names = {topic.name for topic in fitting}
            return [
                topic
                for topic in fitting
                if topic.name.removesuffix("/compressed") not in names - {topic.name}
            ]
        case Role.INFO if Role.IMAGE in found:
            beside = info_name(found[Role.IMAGE].name)
            return [topic for topic in fitting if topic.name == beside] or fitting
        case Role.INFO:
            return []
        case Role.ODOMETRY:
            joints = [topic for topic in fitting if topic.msgtype == JOINTS]
            return (
                joints if by_wheels and joints else [topic for topic in fitting if topic.msgtype == ODOMETRY]
            )
        case _:
            return fitting


def info_name(image: str) -> str:
    """Return the name of the camera's CameraInfo topic beside that of its images."""
    return image.removesuffix("/compressed").rpartition("/")[0] + "/camera_info"


def _roles(name: str, msgtype: str) -> tuple[Role, ...]:
    if msgtype in IMAGES:
        return () if _NO_PICTURE.search(name) else (Role.IMAGE,)
    if msgtype == POSE:
        # Other poses are estimates of other programs: used where they are asked for alone.
        if _START.search(name):
            return (Role.START,)
        return (Role.FIXES,) if _FIXES.search(name) else ()
    return tuple(role for role, kinds in TYPES.items() if msgtype in kinds)
