"""Writing bags: ROS 2 folders, single .mcap files, ROS 1 .bag files, through one small class."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from maps.errors import InputError
from maps.poses import Array, Pose2
from runs.bags.opening import require_rosbags

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore


#: ROS 1 keeps it outside its common messages.
_TF_MESSAGE = "geometry_msgs/TransformStamped[] transforms"


class BagKind(StrEnum):
    """The kinds of bags that are written."""

    MCAP = "mcap"
    SQLITE3 = "sqlite3"
    ROS1 = "ros1"


class BagFile:
    """A bag that is there whole or not at all: `with BagFile(path, kind) as bag`.

    A path with the suffix .mcap, .db3 or .bag becomes one file, another one a ROS 2 folder. It is written into
    `<path>.partial`, renamed at the end and removed on an error.
    """

    def __init__(self, path: Path, kind: BagKind) -> None:
        """InputError where the path holds something already; MissingExtraError without rosbags."""
        require_rosbags()
        self.path, self._kind = path.resolve(), kind
        self._single = kind is BagKind.ROS1 or path.suffix in (".mcap", ".db3")
        self._partial = self.path.with_name(f"{self.path.name}.partial")
        self._types = _types_of(kind)
        self._connections: dict[str, Connection] = {}
        if path.exists() and (path.is_file() or any(path.iterdir())):
            raise InputError(path, "", "is there already")

    def __enter__(self) -> BagFile:
        """Make the partial bag."""
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2

        try:
            shutil.rmtree(self._partial, ignore_errors=True)
            self._partial.mkdir(parents=True)
        except OSError as error:
            raise InputError(self._partial, "", error.strerror or str(error)) from None
        if self._kind is BagKind.ROS1:
            self._writer: Any = Writer1(self._partial / self.path.name)
        else:
            plugin = StoragePlugin.MCAP if self._kind is BagKind.MCAP else StoragePlugin.SQLITE3
            # Tools of ROS 2 Humble and later read version 8.
            name = self.path.stem if self._single else self.path.name
            self._writer = Writer2(self._partial / name, version=8, storage_plugin=plugin)
        self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put it in its place, or take it away."""
        try:
            self._writer.close()
            if kind is None:
                self._place()
        finally:
            shutil.rmtree(self._partial, ignore_errors=True)

    @property
    def beside(self) -> Path | None:
        """The folder where other files of a ROS 2 folder are to be put; None for a single file."""
        if self._single:
            return None
        folder: Path = self._writer.path
        return folder

    def add(self, topic: str, msgtype: str, latched: bool = False) -> None:
        """Add a topic; `latched`: those who come late get its last message."""
        if self._kind is BagKind.ROS1:
            more: dict[str, Any] = {"latching": int(latched)}
        else:
            more = {"offered_qos_profiles": [_latched()] if latched else []}
        self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=self._types, **more)

    def write(self, topic: str, received_ns: int, fields: Mapping[str, Any]) -> None:
        """Write a message given by its fields; messages inside it are mappings too. Times are not before zero."""
        connection = self._connections[topic]
        message = self._message(connection.msgtype, fields)
        serialize = self._types.serialize_ros1 if self._kind is BagKind.ROS1 else self._types.serialize_cdr
        self._writer.write(connection, received_ns, bytes(serialize(message, connection.msgtype)))

    def _message(self, msgtype: str, fields: Mapping[str, Any]) -> Any:
        """Build a message; fields that are not given are zero, empty, or messages of such."""
        from rosbags.interfaces import Nodetype

        built: dict[str, Any] = {}
        for name, (kind, detail) in self._types.fielddefs[msgtype][1]:
            # ROS 1 writes the matrices of a camera with capital letters.
            given = fields.get(name, fields.get(name.lower()))
            if kind is Nodetype.NAME:
                built[name] = self._message(str(detail), given or {})
            elif kind is Nodetype.BASE:
                built[name] = ("" if detail[0] == "string" else 0) if given is None else given
            else:
                built[name] = self._sequence(kind is Nodetype.ARRAY, detail, given)
        return self._types.types[msgtype](**built)

    def _sequence(self, is_array: bool, detail: Any, given: Any) -> Any:
        from rosbags.interfaces import Nodetype

        (kind, element), count = detail
        if kind is Nodetype.NAME:
            return [self._message(element, of) for of in given or ()]
        if element[0] == "string":
            return list(given or ())
        depth = np.dtype("uint8" if element[0] in ("octet", "byte", "char") else element[0])
        return np.asarray(np.zeros(count if is_array else 0) if given is None else given, depth)

    def _place(self) -> None:
        if self._kind is BagKind.ROS1:
            (self._partial / self.path.name).replace(self.path)
        elif self._single:
            written = next(file for file in self._writer.path.iterdir() if file.suffix == self.path.suffix)
            written.replace(self.path)
        else:
            if self.path.exists():
                self.path.rmdir()
            self._writer.path.replace(self.path)


@cache
def _types_of(kind: BagKind) -> Typestore:
    """Return what messages are made of; kept, for the code that writes them takes a while to be made."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if kind is not BagKind.ROS1:
        return get_typestore(Stores.ROS2_HUMBLE)
    types = get_typestore(Stores.ROS1_NOETIC)
    types.register(get_types_from_msg(_TF_MESSAGE, "tf2_msgs/msg/TFMessage"))
    return types


def header(stamp_ns: int, frame: str) -> dict[str, Any]:
    """Return a header's fields."""
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame}


def pose_fields(pose: Pose2) -> dict[str, Any]:
    """Return a pose's fields."""
    return {"position": {"x": pose.x, "y": pose.y, "z": 0.0}, "orientation": turned(pose.phi)}


def covariance_fields(covariance: Array) -> Array:
    """Return the covariance of x, y and phi (3, 3) as that of x, y, z and three angles, (36,)."""
    whole = np.zeros((6, 6))
    rows = np.array([0, 1, 5])
    whole[np.ix_(rows, rows)] = covariance
    return whole.ravel()


def transform_fields(stamp_ns: int, parent: str, child: str, pose: Pose2) -> dict[str, Any]:
    """Return a stamped transform's fields, `parent_from_child`."""
    shift = {"x": pose.x, "y": pose.y, "z": 0.0}
    place = {"translation": shift, "rotation": turned(pose.phi)}
    return {"header": header(stamp_ns, parent), "child_frame_id": child, "transform": place}


def turned(phi: float) -> dict[str, float]:
    """Return a quaternion's fields: a turn about the vertical."""
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(0.5 * phi)), "w": float(np.cos(0.5 * phi))}


def _latched() -> Qos:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
