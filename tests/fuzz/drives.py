"""What holds a drive and is no session folder: bags, a video with stamps, EuRoC and TUM layouts, and odd bags."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "runs"))

from mutations import damaged

from maps.poses import Pose2
from runs import video
from runs.bags import images
from runs.bags.bagfile import BagFile, BagKind, covariance_fields, header, pose_fields
from runs.bags.topics import CAMERA_INFO, IMAGES, JOINTS, ODOMETRY, POSE, TRANSFORMS
from runs.opening import Reading, open_session, wanted_topics

_S = 10**9
_KINDS = {"mcap": BagKind.MCAP, "db3": BagKind.SQLITE3, "bag": BagKind.ROS1}
_CAMERA, _INFO, _STATIC = "/camera/image_raw", "/camera/camera_info", "/tf_static"
_TYPES = {
    _CAMERA: IMAGES[0],
    "/small/image_raw/compressed": IMAGES[1],
    _INFO: CAMERA_INFO,
    "/odom": ODOMETRY,
    "/joint_states": JOINTS,
    "/initialpose": POSE,
    "/fixes": POSE,
    _STATIC: TRANSFORMS[0],
}
_WHEELS = "wheels: {radius_m: 0.05, baseline_m: 0.34}\n"


def look(path: Path, options: Reading | None = None) -> None:
    """Open a drive, and look at every picture: an error of the last one is raised, as a run would tell it."""
    # Whatever lay there before is another one.
    images._album.cache_clear()
    video._reel.cache_clear()
    for frame in open_session(path, options).frames:
        frame.image()


def bag_reader(suffix: str) -> Callable[[Path], None]:
    """Return what reads a bag file, its odometry as messages and as wheels."""

    def read(folder: Path) -> None:
        (folder / "robot.yaml").unlink(missing_ok=True)
        look(folder / f"drive.{suffix}", named(_CAMERA))
        (folder / "robot.yaml").write_text(_WHEELS)
        look(folder / f"drive.{suffix}", named("/small/image_raw/compressed"))

    return read


def named(image: str = _CAMERA) -> Reading:
    """Return what names the topics of which there are several."""
    return Reading(wanted=wanted_topics([f"image={image}", f"info={_INFO}"], None))


@cache
def bag_bytes(suffix: str) -> bytes:
    """Return a good bag of a few messages of every kind that is read."""
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / f"drive.{suffix}"
        write_bag(place, _KINDS[suffix], messages(), _TYPES)
        return place.read_bytes()


def write_bag(
    place: Path,
    kind: BagKind,
    told: list[tuple[str, int, dict[str, Any]]],
    types: dict[str, str],
    rng: np.random.Generator | None = None,
) -> None:
    """Write a bag; with `rng` one of its messages is damaged, and the bag that holds it is not."""
    with BagFile(place, kind) as bag:
        for topic, msgtype in types.items():
            bag.add(topic, msgtype)
        hurt = -1 if rng is None else int(rng.integers(len(told)))
        for number, (topic, at_ns, fields) in enumerate(told):
            if number == hurt and rng is not None:
                _hurt_next(bag._writer, rng)
            bag.write(topic, at_ns, fields)


def _hurt_next(writer: Any, rng: np.random.Generator) -> None:
    whole = writer.write

    def write(connection: Any, at_ns: int, raw: bytes) -> None:
        writer.write = whole
        whole(connection, at_ns, damaged(raw, rng))

    writer.write = write


def messages() -> list[tuple[str, int, dict[str, Any]]]:
    """Return messages: topic, receive stamp, fields."""
    grey = (np.add.outer(np.arange(12), np.arange(16)) * 8).astype(np.uint8)
    small = cv2.imencode(".jpg", grey)[1].ravel()
    matrix = np.array([20.0, 0, 7.5, 0, 20, 5.5, 0, 0, 1])
    turn = {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}
    mount = {"translation": {"x": 0.1, "z": 1.2}, "rotation": turn}
    sure = covariance_fields(0.01 * np.eye(3))
    told: list[tuple[str, int, dict[str, Any]]] = [
        (
            _STATIC,
            _S,
            {
                "transforms": [
                    {"header": header(0, "base_footprint"), "child_frame_id": "cam", "transform": mount}
                ]
            },
        ),
        (
            _INFO,
            _S,
            {
                "header": header(_S, "cam"),
                "width": 16,
                "height": 12,
                "distortion_model": "plumb_bob",
                "d": np.zeros(5),
                "k": matrix,
                "p": np.insert(matrix, [3, 6, 9], 0.0),
            },
        ),
        ("/initialpose", _S, {"header": header(_S, "map"), "pose": {"pose": {}, "covariance": sure}}),
    ]
    for count in range(4):
        at = _S + count * _S // 4
        pose = Pose2(0.1 * count, 0.0, 0.02 * count)
        picture = {"height": 12, "width": 16, "encoding": "mono8", "step": 16, "data": grey.ravel()}
        motion = {"child_frame_id": "base_footprint", "pose": {"pose": pose_fields(pose)}}
        turned = {"name": ["wheel_left", "wheel_right"], "position": np.array([count, 1.1 * count])}
        film = {"header": header(at, "cam"), "format": "jpeg", "data": small}
        fix = {"pose": pose_fields(pose), "covariance": sure}
        told += [
            ("/odom", at, {"header": header(at, "odom"), **motion}),
            ("/joint_states", at, {"header": header(at, ""), **turned}),
            (_CAMERA, at + 5, {"header": header(at, "cam"), **picture}),
            ("/small/image_raw/compressed", at + 5, film),
            ("/fixes", at + 9, {"header": header(at, "map"), "pose": fix}),
        ]
    return told


_ODD_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0.0, -1.0, 1e9, 1e15)
_ODD_COUNTS = (0, 1, 2, 255, 65_535, 2**31 - 1)
_ODD_WORDS = (
    *("", "/", "..", "../../etc/passwd", "a" * 70_000, "\x00", "\u0661"),
    *("wheel_left", "bgr8", "yuv422", "16UC1", "equidistant"),
)


def odd_bag(folder: Path) -> None:
    """Read a bag that is whole, and whose messages say odd things: `draw` draws them, or none where it is empty."""
    drawn = (folder / "draw").read_bytes()[:64]
    rng = np.random.default_rng(list(drawn))
    told = messages()
    types = dict(_TYPES)
    for _ in range(int(rng.geometric(0.4)) if drawn else 0):
        _odd(told, types, rng)
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / "drive.mcap"
        try:
            write_bag(place, BagKind.MCAP, told, types, rng if drawn and rng.random() < 0.5 else None)
        except (ValueError, TypeError, OverflowError, AttributeError, KeyError, AssertionError, IndexError):
            # No message can say that.
            return
        except Exception as error:
            if type(error).__module__.startswith(("struct", "rosbags")):
                return
            raise
        if drawn and rng.random() < 0.3:
            (Path(scratch) / "robot.yaml").write_text(_WHEELS)
        chosen = Reading() if drawn and rng.random() < 0.1 else named()
        look(place, replace(chosen, map_path=folder / "map.yaml"))


def _odd(
    told: list[tuple[str, int, dict[str, Any]]], types: dict[str, str], rng: np.random.Generator
) -> None:
    """Make one thing odd: a message lost, doubled, late, of another topic, or something that it says."""
    number = int(rng.integers(len(told)))
    topic, at_ns, fields = told[number]
    match int(rng.integers(12)):
        case 0:
            told[:] = [one for one in told if one[0] != topic]
        case 1:
            told.append(told[number])
        case 2:
            told[number] = topic, int(rng.choice([0, 1, at_ns + 10**12, 2**62])), fields
        case 3:
            other = told[int(rng.integers(len(told)))]
            types[topic] = types[other[0]]
            told[:] = [(name, at, other[2] if name == topic else of) for name, at, of in told]
        case _:
            told[number] = topic, at_ns, _changed(fields, rng)


def _changed(value: Any, rng: np.random.Generator) -> Any:
    """Return a value with one thing in it, at any depth, that is odd."""
    match value:
        case dict() if value:
            name = list(value)[int(rng.integers(len(value)))]
            return value | {name: _changed(value[name], rng)}
        case list() if value:
            number = int(rng.integers(len(value)))
            lists = [
                value[:number],
                value * 3,
                [*value[:number], _changed(value[number], rng), *value[number + 1 :]],
            ]
            return lists[int(rng.integers(3))]
        case np.ndarray() if value.dtype == np.float64 and value.size:
            odd = value.copy()
            odd[int(rng.integers(len(odd)))] = rng.choice(_ODD_NUMBERS)
            return odd if rng.random() < 0.8 else odd[: int(rng.integers(len(odd)))]
        case np.ndarray():
            return value[: int(rng.integers(len(value) + 1))]
        case float():
            return float(rng.choice(_ODD_NUMBERS))
        case int():
            return int(rng.choice(_ODD_COUNTS))
        case str():
            return str(rng.choice(_ODD_WORDS))
    return value


def lay_ros2_folder(folder: Path) -> None:
    """Lay a ROS 2 folder, its storage beside the metadata that is changed."""
    with TemporaryDirectory() as scratch:
        write_bag(Path(scratch) / "bag", BagKind.SQLITE3, messages(), _TYPES)
        (folder / "bag").mkdir(exist_ok=True)
        for file in (Path(scratch) / "bag").iterdir():
            shutil.copyfile(file, folder / "bag" / file.name)


@cache
def metadata() -> bytes:
    """Return the metadata of such a folder."""
    with TemporaryDirectory() as scratch:
        lay_ros2_folder(Path(scratch))
        return (Path(scratch) / "bag" / "metadata.yaml").read_bytes()


@cache
def film() -> bytes:
    """Return a small video of four frames."""
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / "drive.avi"
        writer = cv2.VideoWriter(str(place), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (64, 48))
        rng = np.random.default_rng(1)
        for _ in range(4):
            writer.write(rng.integers(0, 255, (48, 64, 3), np.uint8))
        writer.release()
        return place.read_bytes()


SENSOR = b"""T_BS:
  cols: 4
  rows: 4
  data: [0.0, -0.19866933, 0.98006658, 0.3, -1.0, 0.0, 0.0, 0.05, 0.0, -0.98006658, -0.19866933, 0.9, 0, 0, 0, 1]
resolution: [640, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""
EUROC_ROWS = b"#timestamp [ns],filename\r\n200000000,a.jpg\r\n700000000,b.jpg\r\n"
TUM_ROWS = b"# timestamp filename\n0.2 rgb/a.jpg\n0.7 rgb/b.jpg\n"
STAMPS = b"timestamp_s,arrival_s\n0.2,0.3\n0.4,0.5\n0.6,0.7\n0.8,0.8\n"
