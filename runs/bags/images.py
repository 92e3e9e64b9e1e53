"""The images of a bag, read when they are looked at: memory does not grow with the bag."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any
from weakref import finalize

import numpy as np

from maps.errors import InputError
from runs.bags.opening import header_stamp_ns, opened, told
from vision.rawimages import RawImage, raw_file

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

#: Images kept for whoever asks again: the recording looks at what the matcher saw.
_KEPT = 8
#: Farther ahead than this it is faster to look the place up than to read on.
_AHEAD_NS = 5 * 10**9


@dataclass(frozen=True, slots=True)
class BagPicture:
    """One image message, by its bag, its topic, its header's stamp and when it was received."""

    bag: Path
    topic: str
    msgtype: str
    stamp_ns: int
    received_ns: int

    def read(self) -> bytes:
        """Return the image as a file's bytes; InputError where the message cannot be read."""
        return _album(self.bag, self.topic, self.msgtype).read(self.stamp_ns, self.received_ns)


class Album:
    """Reads the images of one topic, best in the order in which they were received; any thread may ask."""

    def __init__(self, bag: Path, topic: str, msgtype: str) -> None:
        """Open nothing yet."""
        self._bag, self._topic, self._msgtype = bag, topic, msgtype
        self._lock = Lock()
        self._open = ExitStack()
        finalize(self, self._open.close)
        self._reader: AnyReader | None = None
        self._messages: Iterator[tuple[Connection, int, bytes]] = iter(())
        self._at_ns: int | None = None
        self._recent: OrderedDict[tuple[int, int], bytes] = OrderedDict()

    def read(self, stamp_ns: int, received_ns: int) -> bytes:
        """Return an image as a file's bytes; InputError where it is not there, or cannot be read."""
        key = received_ns, stamp_ns
        with self._lock:
            if key not in self._recent:
                with told(self._bag):
                    self._recent[key] = self._file(self._message(stamp_ns, received_ns))
            self._recent.move_to_end(key)
            while len(self._recent) > _KEPT:
                self._recent.popitem(last=False)
            return self._recent[key]

    def _message(self, stamp_ns: int, received_ns: int) -> Any:
        """Find a message, reading on from the last one where that is near."""
        reader = self._opened()
        if self._at_ns is None or not self._at_ns < received_ns < self._at_ns + _AHEAD_NS:
            connections = [
                of for of in reader.connections if (of.topic, of.msgtype) == (self._topic, self._msgtype)
            ]
            self._messages = reader.messages(connections, start=received_ns)
        for _, at_ns, raw in self._messages:
            self._at_ns = at_ns
            if at_ns > received_ns:
                break
            if at_ns == received_ns and stamp_ns in (0, header_stamp_ns(raw, reader.is2)):
                return reader.deserialize(raw, self._msgtype)
        self._at_ns = None
        raise InputError(self._bag, self._topic, f"the image received at {received_ns / 1e9:.6f} s is gone")

    def _opened(self) -> AnyReader:
        if self._reader is None:
            self._reader = self._open.enter_context(opened(self._bag))
        return self._reader

    def _file(self, message: Any) -> bytes:
        if self._msgtype.endswith("CompressedImage"):
            return bytes(message.data)
        raw = RawImage(
            message.encoding,
            int(message.width),
            int(message.height),
            int(message.step),
            bool(message.is_bigendian),
            np.asarray(message.data, np.uint8),
        )
        try:
            return raw_file(raw)
        except ValueError as error:
            raise InputError(self._bag, self._topic, str(error)) from None


@lru_cache(maxsize=4)
def _album(bag: Path, topic: str, msgtype: str) -> Album:
    """One for all who ask: a run's pictures are looked at by several threads, in one order."""
    return Album(bag, topic, msgtype)
