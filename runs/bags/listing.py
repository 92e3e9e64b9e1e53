"""What is in a bag, for people who choose its topics."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from maps.errors import InputError
from runs.bags.opening import opened
from runs.bags.reading import robot_of
from runs.bags.topics import Role, Topic, Wanted, choose, listed, transforms


@dataclass(frozen=True, slots=True)
class TopicUse:
    """A topic, what it could be read for, and what it would be read for; empty: for nothing."""

    name: str
    msgtype: str
    count: int
    roles: tuple[str, ...]
    use: str

    def as_json(self) -> dict[str, Any]:
        """Return it with names that a program reads."""
        told = asdict(self)
        return {
            "topic": told["name"],
            "type": told["msgtype"],
            "messages": told["count"],
            "roles": list(self.roles),
            "use": self.use or None,
        }


def topic_uses(bag: Path, robot_path: Path | None, wanted: Wanted) -> tuple[tuple[TopicUse, ...], str | None]:
    """Return a bag's topics with their uses, and what is left to choose; InputError where it is no bag.

    Which odometry is read depends on the robot: wheel angles are of use where its wheels are known.
    """
    by_wheels = robot_of(bag, robot_path).wheels is not None
    with opened(bag) as reader:
        topics = listed(bag, reader)
    chosen: dict[Role, Topic] = {}
    question = None
    try:
        chosen = choose(bag, topics, wanted, by_wheels)
    except InputError as error:
        question = str(error)
    static = transforms(topics) if Role.IMAGE in chosen else []
    uses = {id(topic): role.value for role, topic in chosen.items()} | {id(of): "transforms" for of in static}
    return (
        tuple(TopicUse(of.name, of.msgtype, of.count, of.roles, uses.get(id(of), "")) for of in topics),
        question,
    )
