"""Compressed bags: read as others are, and refused where a chunk would fill the memory."""

import sys

import numpy as np
import pytest

pytest.importorskip("rosbags")

from bagtoys import drawn, odometry_fields, raw_fields
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from rosbags.rosbag2 import Writer as Writer2

from maps.errors import InputError
from maps.poses import Pose2
from runs.bags import images
from runs.bags.bagfile import BagFile, BagKind
from runs.bags.chunks import bound_chunks
from runs.bags.opening import opened, told

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

IMAGE = drawn(3, 100, 160)


@pytest.fixture(params=["BZ2", "LZ4", "MESSAGE", "FILE"])
def bag(request, tmp_path, monkeypatch):
    """Return a bag of one picture: ROS 1 with compressed chunks, or ROS 2 compressed by message or file."""
    if request.param in ("BZ2", "LZ4"):
        writer, how, path = Writer, (Writer.CompressionFormat[request.param],), tmp_path / "drive.bag"
        kind = BagKind.ROS1
    else:
        how = (CompressionMode[request.param], CompressionFormat.ZSTD)
        writer, kind, path = Writer2, BagKind.SQLITE3, tmp_path / "drive"
    begin = writer.open

    def compressed(self):
        self.set_compression(*how)
        begin(self)

    monkeypatch.setattr(writer, "open", compressed)
    images._album.cache_clear()
    with BagFile(path, kind) as bag:
        bag.add("/camera/image_raw", "sensor_msgs/msg/Image")
        bag.add("/odom", "nav_msgs/msg/Odometry")
        bag.write("/camera/image_raw", 10**9, raw_fields(10**9, IMAGE))
        bag.write("/odom", 10**9, odometry_fields(10**9, Pose2(0.0, 0.0, 0.0)))
    return path


def pictures(path):
    """Return the pixels of a bag's images."""
    with opened(path) as reader, told(path):
        found = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic.endswith("image_raw")
        ]
    return [np.asarray(message.data).reshape(message.height, message.width) for message in found]


def test_compressed_chunks_are_read(bag):
    (picture,) = pictures(bag)
    assert (picture == IMAGE).all()


@pytest.mark.parametrize("bag", ["BZ2", "LZ4", "MESSAGE"], indirect=True)
def test_what_grows_too_large_is_refused(bag, monkeypatch):
    monkeypatch.setattr("runs.bags.chunks.MOST_BYTES", 10_000)
    with pytest.raises(InputError, match=r"drive.*: a damaged bag \(ValueError a chunk of more than"):
        pictures(bag)


def test_so_it_is_in_mcap(monkeypatch):
    from rosbags.rosbag2 import storage_mcap

    bound_chunks()
    content = bytes(10**6)
    packed = zstd.compress(content)
    assert storage_mcap.decompress(packed, "zstd", len(content), 0) == content
    with pytest.raises(EOFError, match="half"):
        storage_mcap.decompress(packed[:-4], "zstd", len(content), 0)
    monkeypatch.setattr("runs.bags.chunks.MOST_BYTES", 10_000)
    with pytest.raises(ValueError, match="more than"):
        storage_mcap.decompress(packed, "zstd", len(content), 0)
