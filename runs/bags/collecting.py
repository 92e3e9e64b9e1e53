"""One pass through a bag: what its messages say, and of the images no more than when they were taken."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maps.errors import InputError
from runs.bags.mounting import FrameTree
from runs.bags.opening import header_stamp_ns, stamp_ns, told
from runs.bags.topics import IMAGES, JOINTS, Role, Topic, Wanted, transforms
from runs.bags.wheels import TwistRows, WheelRows
from runs.tables import MAX_TIME_S, Times

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

logger = logging.getLogger(__name__)

#: The first messages of a kind are enough to tell whether a transform stays; later ones would only take time.
_TRANSFORMS = 2000


@dataclass(slots=True)
class Stamps:
    """When the messages of a topic were stamped and received [ns]."""

    stamped: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)

    def ordered(self, path: Path, topic: str) -> tuple[Times, Times, NDArray[np.intp]]:
        """Return stamps, arrivals and the rows they belong to, in order of stamps, no stamp twice.

        Messages that nobody stamped count from when they were received.
        """
        stamps, received = np.array(self.stamped, np.int64), np.array(self.received, np.int64)
        if len(stamps) > 1 and not stamps.any():
            logger.warning("%s: %s has no stamps: received counts as captured", path, topic)
            stamps = received
        late = np.flatnonzero((stamps < 0) | (stamps > MAX_TIME_S * 1e9))
        if len(late):
            raise InputError(path, topic, f"a stamp of {stamps[late[0]] / 1e9:.0f} s is no time")
        kept_ns, rows = np.unique(stamps, return_index=True)
        if len(rows) < len(stamps):
            logger.warning(
                "%s: %s: %d messages repeat a stamp and are left out", path, topic, len(stamps) - len(rows)
            )
        return kept_ns, np.maximum(received[rows], kept_ns), rows


@dataclass(slots=True)
class Contents:
    """What one pass through a bag collects."""

    odometry: WheelRows | TwistRows
    tree: FrameTree = field(default_factory=FrameTree)
    stamps: dict[Role, Stamps] = field(default_factory=dict)
    suffixes: list[str] = field(default_factory=list)
    camera_frame: str = ""
    info: Any = None
    start: Any = None
    fixes: list[Any] = field(default_factory=list)


def collect(
    reader: AnyReader, bag: Path, topics: tuple[Topic, ...], chosen: dict[Role, Topic], wanted: Wanted
) -> Contents:
    """Go through an open bag once, looking at no more of the images than their stamps; InputError if damaged."""
    motion = chosen.get(Role.ODOMETRY)
    wheels = motion is not None and motion.msgtype == JOINTS
    rows = WheelRows(bag, motion.name, wanted.joints) if wheels and motion else TwistRows()
    contents = Contents(rows, stamps={role: Stamps() for role in chosen})
    by_topic = {(topic.name, topic.msgtype): role for role, topic in chosen.items()}
    static = transforms(topics) if Role.IMAGE in chosen else []
    connections = [of for topic in (*chosen.values(), *static) for of in topic.connections]
    moved = 0
    with told(bag):
        for connection, received_ns, raw in reader.messages(connections) if connections else ():
            role = by_topic.get((connection.topic, connection.msgtype))
            if role is None:
                moved += 1
                if moved <= _TRANSFORMS:
                    contents.tree.take(reader.deserialize(raw, connection.msgtype))
            elif role is Role.IMAGE:
                _take_image(contents, reader, connection.msgtype, raw)
                _stamped(contents, role, header_stamp_ns(raw, reader.is2), received_ns)
            elif role is Role.INFO and contents.info is not None:
                continue
            else:
                message = reader.deserialize(raw, connection.msgtype)
                if _take(contents, role, message):
                    _stamped(contents, role, stamp_ns(message), received_ns)
    return contents


def _stamped(contents: Contents, role: Role, stamped_ns: int, received_ns: int) -> None:
    contents.stamps[role].stamped.append(stamped_ns)
    contents.stamps[role].received.append(received_ns)


def _take_image(contents: Contents, reader: AnyReader, msgtype: str, raw: bytes) -> None:
    if not contents.suffixes:
        message: Any = reader.deserialize(raw, msgtype)
        contents.camera_frame = message.header.frame_id
    compressed = msgtype == IMAGES[1]
    contents.suffixes.append(".jpg" if compressed and b"\x89PNG" not in raw[:512] else ".png")


def _take(contents: Contents, role: Role, message: Any) -> bool:
    """Keep what a message tells; False where it tells nothing."""
    match role:
        case Role.ODOMETRY:
            return contents.odometry.take(message)
        case Role.INFO:
            contents.info = message
        case Role.START:
            contents.start = contents.start or message
        case Role.FIXES:
            contents.fixes.append(message)
    return True
