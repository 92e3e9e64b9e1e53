"""A session, written as a bag that any tool of ROS reads."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from localization.odometry import OdometryNoise, advance
from maps.errors import InputError
from maps.outcomes import PoseBelief
from maps.poses import Pose2
from runs.bags.bagfile import BagFile, BagKind, covariance_fields, header, pose_fields
from runs.bags.folder import Progress, copy_beside, raw_values, robot_text
from runs.bags.topics import CAMERA_INFO, IMAGES, JOINTS, ODOMETRY, POSE, TRANSFORMS
from runs.camerainfo import ros_model_of
from runs.session import Frame, Odometry, Session
from vision.camera import Camera
from vision.rawimages import kept_file, plain_file

IMAGE_TOPIC, INFO_TOPIC = "/camera/image/compressed", "/camera/camera_info"
JOINTS_TOPIC, ODOMETRY_TOPIC = "/joint_states", "/odom"
START_TOPIC, FIXES_TOPIC, STATIC_TOPIC = "/initialpose", "/wireloc/fixes", "/tf_static"
CAMERA_FRAME, BASE_FRAME = "camera_optical_frame", "base_footprint"
WHEEL_JOINTS = ("left_wheel_joint", "right_wheel_joint")

#: A topic, when its message was received, and the message's fields.
Message = tuple[str, int, dict[str, Any]]


def write_bag(session: Session, out: Path, kind: BagKind, progress: Progress) -> None:
    """Write a session as a bag; there whole, or not at all. In a ROS 2 folder robot.yaml and map.yaml go along.

    InputError where `out` holds something already, an image cannot be read, or a time is before zero.
    """
    images_ns = [frame.stamp_ns - session.robot.time_offset_ns for frame in session.frames]
    if min(session.start_ns, *images_ns, 0) < 0:
        raise InputError(session.folder, "", "times before zero have no place in a bag")
    with BagFile(out, kind) as bag:
        for topic, msgtype in _topics(session).items():
            bag.add(topic, msgtype, latched=topic in (STATIC_TOPIC, START_TOPIC))
        for topic, received_ns, fields in _opening(session):
            bag.write(topic, received_ns, fields)
        streams = (_odometry(session), _frames(session, progress), _fixes(session))
        for topic, received_ns, fields in heapq.merge(*streams, key=itemgetter(1)):
            bag.write(topic, received_ns, fields)
        if bag.beside is not None:
            (bag.beside / "robot.yaml").write_text(robot_text(session.robot), encoding="utf-8")
            copy_beside(session, bag.beside)


def _topics(session: Session) -> dict[str, str]:
    by_wheels = session.odometry.wheels is not None
    topics = {JOINTS_TOPIC: JOINTS} if by_wheels else {ODOMETRY_TOPIC: ODOMETRY}
    if session.frames:
        topics |= {IMAGE_TOPIC: IMAGES[1], INFO_TOPIC: CAMERA_INFO, STATIC_TOPIC: TRANSFORMS[0]}
    if session.fixes:
        topics[FIXES_TOPIC] = POSE
    if session.robot.start is not None:
        topics[START_TOPIC] = POSE
    return topics


def _opening(session: Session) -> Iterator[Message]:
    """Yield what does not change: where the camera sits, and where the robot starts."""
    start_ns = session.start_ns
    if session.frames and session.camera is not None:
        yield STATIC_TOPIC, start_ns, {"transforms": [mount_fields(session.camera, start_ns)]}
    if session.robot.start is not None:
        yield START_TOPIC, start_ns, _belief(session.robot.start.at(start_ns))


def _odometry(session: Session) -> Iterator[Message]:
    odometry, values = session.odometry, raw_values(session)
    stamps_ns, arrivals_ns = odometry.stamps_ns.tolist(), np.maximum.accumulate(odometry.arrivals_ns).tolist()
    if odometry.wheels is not None:
        for stamp_ns, arrival_ns, angles in zip(stamps_ns, arrivals_ns, values, strict=True):
            fields = {"header": header(stamp_ns, ""), "name": WHEEL_JOINTS, "position": angles}
            yield JOINTS_TOPIC, arrival_ns, fields
        return
    raw = Odometry(odometry.stamps_ns, odometry.arrivals_ns, values, None)
    steps = (step for _, step in raw.steps(OdometryNoise()))
    poses = accumulate(steps, advance, initial=Pose2(0.0, 0.0, 0.0))
    for stamp_ns, arrival_ns, pose, twist in zip(stamps_ns, arrivals_ns, poses, values.tolist(), strict=True):
        fields = {
            "header": header(stamp_ns, "odom"),
            "child_frame_id": BASE_FRAME,
            "pose": {"pose": pose_fields(pose)},
            "twist": {"twist": {"linear": {"x": twist[0]}, "angular": {"z": twist[1]}}},
        }
        yield ODOMETRY_TOPIC, arrival_ns, fields


def _frames(session: Session, progress: Progress) -> Iterator[Message]:
    frames = sorted(session.frames, key=lambda frame: frame.arrival_ns)
    for done, frame in enumerate(frames, start=1):
        told = header(frame.stamp_ns - session.robot.time_offset_ns, CAMERA_FRAME)
        if session.camera is not None:
            yield INFO_TOPIC, frame.arrival_ns, {"header": told, **_info(session.camera)}
        form, content = _compressed(frame)
        data = np.frombuffer(content, np.uint8)
        yield IMAGE_TOPIC, frame.arrival_ns, {"header": told, "format": form, "data": data}
        progress(done, len(frames))


def _fixes(session: Session) -> Iterator[Message]:
    for recorded in sorted(session.fixes, key=lambda recorded: recorded.arrival_ns):
        yield FIXES_TOPIC, recorded.arrival_ns, _belief(recorded.fix.belief)


def _compressed(frame: Frame) -> tuple[str, bytes]:
    """Return an image's format and file; what is neither JPEG nor PNG becomes a grey PNG."""
    content = kept_file(frame.data())
    if content.startswith(b"\xff\xd8\xff"):
        return "jpeg", content
    return "png", content if content.startswith(b"\x89PNG") else kept_file(plain_file(frame.image()))


def _belief(belief: PoseBelief) -> dict[str, Any]:
    known = {"pose": pose_fields(belief.pose), "covariance": covariance_fields(belief.covariance)}
    return {"header": header(belief.stamp_ns, "map"), "pose": known}


def _info(camera: Camera) -> dict[str, Any]:
    return {
        "width": camera.width,
        "height": camera.height,
        "distortion_model": ros_model_of(camera),
        "d": camera.distortion,
        "k": camera.matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([camera.matrix, np.zeros(3)]).ravel(),
    }


def mount_fields(camera: Camera, stamp_ns: int) -> dict[str, Any]:
    """Return the transform of the camera's optical frame; the robot's frame is on the floor between its wheels."""
    rotation, place = camera.map_from_optical(Pose2(0.0, 0.0, 0.0))
    x, y, z = place.tolist()
    turn = dict(zip("xyzw", _quaternion(rotation), strict=True))
    fields = {"translation": {"x": x, "y": y, "z": z}, "rotation": turn}
    return {"header": header(stamp_ns, BASE_FRAME), "child_frame_id": CAMERA_FRAME, "transform": fields}


def _quaternion(rotation: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    """Return x, y, z, w of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    turn: list[float] = Rotation.from_matrix(rotation).as_quat().tolist()
    return turn
