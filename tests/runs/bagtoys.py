"""Small bags and sessions, made for tests of reading them."""

import shutil

import numpy as np
import pytest

pytest.importorskip("rosbags")

from runs.bags.bagfile import BagFile, BagKind, header, pose_fields

#: Where a bag goes to be of a kind, and how it is asked for.
KINDS = {
    "mcap folder": ("bag", ()),
    "sqlite3 folder": ("bag", ("--storage", "sqlite3")),
    "mcap file": ("drive.mcap", ()),
    "sqlite3 file": ("drive.db3", ()),
    "ros1 file": ("drive.bag", ()),
}


def cut_sample(sample, folder, frames=3):
    """Copy the sample session with its first frames alone, and the odometry up to there."""
    folder.mkdir()
    for name in ("robot.yaml", "map.yaml", "ground_truth_dense.csv"):
        shutil.copy(sample / name, folder / name)
    rows = (sample / "frames.csv").read_text().splitlines()[: frames + 1]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    (folder / "images").mkdir()
    for row in rows[1:]:
        shutil.copy(sample / row.split(",")[1], folder / row.split(",")[1])
    end = float(rows[-1].split(",")[0]) + 0.1
    first, *others = (sample / "odometry.csv").read_text().splitlines()
    kept = [row for row in others if float(row.split(",")[0]) <= end]
    (folder / "odometry.csv").write_text("\n".join([first, *kept]) + "\n")
    return folder


def write_table(path, header, rows):
    """Write a CSV file."""
    path.write_text("\n".join([header, *rows]) + "\n")


def drawn(seed, height=12, width=16, channels=1):
    """Return a small picture of noise (H, W) or (H, W, C)."""
    shape = (height, width) if channels == 1 else (height, width, channels)
    return np.random.default_rng(seed).integers(0, 255, shape, np.uint8)


def raw_fields(stamp_ns, image, encoding="mono8", frame="camera_optical"):
    """Return the fields of an Image message."""
    height, width = image.shape[:2]
    return {
        "header": header(stamp_ns, frame),
        "height": height,
        "width": width,
        "encoding": encoding,
        "step": image[0].nbytes,
        "data": np.frombuffer(image.tobytes(), np.uint8),
    }


def info_fields(width=16, height=12, **more):
    """Return the fields of a CameraInfo message."""
    return {
        "header": header(0, "camera_optical"),
        "width": width,
        "height": height,
        "distortion_model": "plumb_bob",
        "d": np.array([0.1, -0.02, 0.001, 0.002, 0.0]),
        "k": np.array([20.0, 0.0, 7.5, 0.0, 21.0, 5.5, 0.0, 0.0, 1.0]),
        "p": np.array([19.0, 0.0, 7.0, 0.0, 0.0, 19.5, 5.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        **more,
    }


def odometry_fields(stamp_ns, pose, forward=0.0, turn=0.0, base="base_link"):
    """Return the fields of an Odometry message."""
    return {
        "header": header(stamp_ns, "odom"),
        "child_frame_id": base,
        "pose": {"pose": pose_fields(pose)},
        "twist": {"twist": {"linear": {"x": forward}, "angular": {"z": turn}}},
    }


def transform(parent, child, shift, turn=(0.0, 0.0, 0.0, 1.0)):
    """Return a stamped transform's fields."""
    return {
        "header": header(0, parent),
        "child_frame_id": child,
        "transform": {
            "translation": dict(zip("xyz", shift, strict=True)),
            "rotation": dict(zip("xyzw", turn, strict=True)),
        },
    }


def write_messages(path, topics, messages, kind=BagKind.MCAP):
    """Write a bag: `topics` by name with their types, `messages` of topic, receive stamp and fields."""
    with BagFile(path, kind) as bag:
        for name, msgtype in topics.items():
            bag.add(name, msgtype)
        for topic, received_ns, fields in messages:
            bag.write(topic, received_ns, fields)
    return path
