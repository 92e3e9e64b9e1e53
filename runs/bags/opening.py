"""Opening bags: ROS 2 folders, single .mcap and .db3 files, ROS 1 .bag files."""

from __future__ import annotations

import sqlite3
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maps.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

#: The storage files of ROS 1 and 2.
SUFFIXES = (".bag", ".mcap", ".db3")

#: What a library that unpacks a damaged file stumbles over; it does not check all that it reads.
_DAMAGE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    RecursionError,
    RuntimeError,
    TypeError,
    ValueError,
    sqlite3.Error,
    struct.error,
)


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: by its suffix, or by what the folder holds."""
    if path.is_dir():
        found = any(file.suffix in SUFFIXES for file in path.iterdir())
        return found and not (path / "odometry.csv").exists()
    return path.suffix in SUFFIXES


@contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """Open a bag for reading; InputError where it is none, MissingExtraError without rosbags.

    What is damaged comes up while it is being read: keep `told(path)` around every use of what this yields.
    """
    require_rosbags()
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    from runs.bags.chunks import bound_chunks

    bound_chunks()

    if not path.exists():
        raise InputError(path, "", "no such file or folder")
    file = _lone_file(path)
    with told(path):
        # Bags older than ROS 2 Iron do not say what their messages are made of.
        reader = AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn what rosbags raises over a damaged bag into an InputError."""
    import apsw
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as ReaderError1
    from rosbags.rosbag2 import ReaderError as ReaderError2
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    stated = (AnyReaderError, ReaderError1, ReaderError2, SerdeError, TypesysError)
    try:
        yield
    except stated as error:
        raise InputError(path, "", f"not a bag that can be read: {error}") from None
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from None
    except (*_DAMAGE, apsw.Error, zstd.ZstdError) as error:
        what = f"{type(error).__name__} {error}".strip()
        raise InputError(path, "", f"a damaged bag ({what})") from None


def require_rosbags() -> None:
    """Raise MissingExtraError where rosbags is not installed."""
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError:
        raise MissingExtraError("bags need rosbags: pip install 'wireloc[bags]'") from None


def header_stamp_ns(raw: bytes | memoryview, ros2: bool) -> int:
    """Return the stamp of a serialized message that begins with a header, without reading the rest.

    CDR: four bytes that tell the byte order, then seconds and nanoseconds; ROS 1: a sequence number first.
    """
    order = "<" if not ros2 or raw[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}{'iI' if ros2 else 'II'}", raw, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message's header."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _lone_file(path: Path) -> Path:
    """Return the storage file of a folder that lost its metadata.yaml, else the path itself."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
    if len(files) != 1:
        what = "no metadata.yaml, and no bag file" if not files else "no metadata.yaml, and several bag files"
        raise InputError(path, "", what)
    return files[0]
