"""A bag as a session: its messages as the rows that a session folder would have.

Header stamps are the capture times, receive stamps the arrivals. What robot.yaml says is not asked of the bag.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from localization.odometry import OdometryNoise, advance
from maps.errors import InputError
from maps.outcomes import Fix, PoseBelief
from maps.poses import Array, Pose2, frozen
from runs.bags.collecting import Contents, collect
from runs.bags.images import BagPicture
from runs.bags.mounting import camera_of_message, mounted
from runs.bags.opening import opened, stamp_ns, told
from runs.bags.topics import JOINTS, Role, Topic, Wanted, choose, listed
from runs.bags.wheels import TwistRows, WheelRows, heading, held_twists
from runs.robot import Robot, Start, read_robot
from runs.session import Frame, Odometry, RecordedFix, Session, session_of

logger = logging.getLogger(__name__)

#: How well an initial pose is known that does not say it: metres, metres, radians.
_MARK = (0.1, 0.1, 0.09)


def read_bag(
    bag: Path, map_path: Path | None = None, robot_path: Path | None = None, wanted: Wanted | None = None
) -> Session:
    """Read a bag as a session; its images stay in it until they are looked at.

    The map is `map_path`, or map.yaml in the bag's folder or one folder up; so is robot.yaml, which may be missing.
    InputError names what is missing, of several kinds, or damaged; MissingExtraError without rosbags.
    """
    wanted = wanted or Wanted()
    robot = robot_of(bag, robot_path)
    with opened(bag) as reader:
        topics = listed(bag, reader)
        named_joints = any(t.name == wanted.topics.get(Role.ODOMETRY) and t.msgtype == JOINTS for t in topics)
        if named_joints and robot.wheels is None:
            raise InputError(
                robot.path, "wheels", "missing, and the odometry is to be wheel angles: see --robot"
            )
        chosen = choose(bag, topics, wanted, robot.wheels is not None)
        contents = collect(reader, bag, topics, chosen, wanted)
    if Role.ODOMETRY not in chosen:
        kinds = "Odometry, nor JointState with the wheels of a robot.yaml"
        raise InputError(bag, "", f"no odometry: no topic with {kinds}")
    # A bag says itself what its messages are made of, which need not be what they should be.
    with told(bag):
        odometry = _odometry(bag, chosen[Role.ODOMETRY], contents, robot)
        frames = _frames(bag, chosen.get(Role.IMAGE), contents, robot)
        fixes = _fixes(bag, chosen.get(Role.FIXES), contents)
        if frames and robot.camera is None:
            robot = _with_camera(bag, robot, chosen, contents)
        if robot.start is None and contents.start is not None:
            robot = replace(robot, start=_start(bag, chosen[Role.START], contents.start, odometry))
    return session_of(bag, robot, odometry, frames, fixes, map_path)


def robot_of(bag: Path, named: Path | None) -> Robot:
    """Return what robot.yaml says, the named one or that in the bag or beside it; nothing where there is none."""
    places = [named] if named else [bag / "robot.yaml", bag.resolve().parent / "robot.yaml"]
    found = next((place for place in places if named or place.is_file()), None)
    return read_robot(found) if found else Robot(bag, None, None, 0, None)


def _odometry(bag: Path, topic: Topic, contents: Contents, robot: Robot) -> Odometry:
    stamps_ns, arrivals_ns, rows = contents.stamps[Role.ODOMETRY].ordered(bag, topic.name)
    if len(stamps_ns) < 2:
        what = (
            "fewer than two messages with the wheels' joints: see --joints"
            if topic.msgtype == JOINTS
            else "fewer than two messages"
        )
        raise InputError(bag, topic.name, what)
    collected = contents.odometry
    if isinstance(collected, WheelRows):
        values = collected.rows()[rows]
    else:
        poses, twists = np.array(collected.poses)[rows], np.array(collected.twists)[rows]
        _check(bag, topic.name, poses, twists)
        values, jumps = held_twists(stamps_ns, poses, twists)
        if jumps:
            logger.warning("%s: %s: %d jumps of the pose; the twists count there", bag, topic.name, jumps)
        values = values * robot.twist_scales
    _check(bag, topic.name, values)
    wheels = robot.wheels if isinstance(collected, WheelRows) else None
    return Odometry(stamps_ns, arrivals_ns, frozen(values), wheels)


def _frames(bag: Path, topic: Topic | None, contents: Contents, robot: Robot) -> tuple[Frame, ...]:
    if topic is None:
        return ()
    stamps_ns, arrivals_ns, rows = contents.stamps[Role.IMAGE].ordered(bag, topic.name)
    place, frames = bag.resolve(), []
    for stamped_ns, arrival_ns, row in zip(
        stamps_ns.tolist(), arrivals_ns.tolist(), rows.tolist(), strict=True
    ):
        received_ns = contents.stamps[Role.IMAGE].received[row]
        picture = BagPicture(
            place, topic.name, topic.msgtype, contents.stamps[Role.IMAGE].stamped[row], received_ns
        )
        filename = f"images/{stamped_ns // 10**9}.{stamped_ns % 10**9:09d}{contents.suffixes[row]}"
        corrected_ns = stamped_ns + robot.time_offset_ns
        frames.append(Frame(corrected_ns, max(arrival_ns, corrected_ns), filename, bag / filename, picture))
    return tuple(frames)


def _fixes(bag: Path, topic: Topic | None, contents: Contents) -> tuple[RecordedFix, ...]:
    if topic is None:
        return ()
    stamps_ns, arrivals_ns, rows = contents.stamps[Role.FIXES].ordered(bag, topic.name)
    fixes = []
    for stamped_ns, arrival_ns, row in zip(
        stamps_ns.tolist(), arrivals_ns.tolist(), rows.tolist(), strict=True
    ):
        pose, deviations = _pose(bag, topic, contents.fixes[row])
        belief = PoseBelief(stamped_ns, pose, np.diag(deviations) ** 2)
        fixes.append(RecordedFix(stamped_ns, arrival_ns, Fix(belief)))
    return tuple(fixes)


def _with_camera(bag: Path, robot: Robot, chosen: dict[Role, Topic], contents: Contents) -> Robot:
    """Take the camera from CameraInfo and the transforms."""
    if contents.info is None:
        what = "no camera: neither a CameraInfo topic beside the images nor robot.yaml (--robot)"
        raise InputError(bag, chosen[Role.IMAGE].name, what)
    rectified = "rect" in chosen[Role.IMAGE].name.removesuffix("/compressed").rpartition("/")[2]
    camera = camera_of_message(bag, chosen[Role.INFO].name, contents.info, rectified)
    frame = contents.info.header.frame_id or contents.camera_frame
    base = contents.odometry.frame if isinstance(contents.odometry, TwistRows) else ""
    return replace(robot, camera=mounted(camera, contents.tree.mount(bag, frame, base)))


def _start(bag: Path, topic: Topic, message: Any, odometry: Odometry) -> Start:
    """Return the pose at the session's first event: that of the message, less what was driven before it."""
    if not np.any(message.pose.covariance):
        logger.warning("%s: %s: a pose without a covariance; a mark on the floor is meant", bag, topic.name)
        message.pose.covariance[[0, 7, 35]] = np.square(_MARK)
    pose, deviations = _pose(bag, topic, message)
    until_ns = stamp_ns(message)
    steps = (step for _, step in odometry.steps(OdometryNoise()))
    moved = Pose2(0.0, 0.0, 0.0)
    for step in takewhile(lambda step: step.stamp_ns <= until_ns, steps):
        moved = advance(moved, step)
    start = pose @ moved.inverse()
    if not np.isfinite(deviations[2]):
        if moved != Pose2(0.0, 0.0, 0.0):
            raise InputError(bag, topic.name, "a position without a heading, after the robot had moved")
        return Start(start, deviations[0], deviations[1], deviations[2])
    # Where the heading was off, so was the way back.
    back = np.array([pose.y - start.y, start.x - pose.x]) * deviations[2]
    return Start(
        start, float(np.hypot(deviations[0], back[0])), float(np.hypot(deviations[1], back[1])), deviations[2]
    )


def _pose(bag: Path, topic: Topic, message: Any) -> tuple[Pose2, list[float]]:
    """Return a message's pose and its standard deviations; a heading without a finite one is not known."""
    told_pose = message.pose.pose
    values = np.array([told_pose.position.x, told_pose.position.y, heading(told_pose.orientation)])
    variances = np.array(message.pose.covariance, float)[[0, 7, 35]]
    _check(bag, topic.name, values, variances[:2])
    if not (variances > 0.0).all():
        raise InputError(bag, topic.name, "a pose without a covariance: its variances are not above zero")
    return Pose2.from_array(values), np.sqrt(variances).tolist()


def _check(bag: Path, topic: str, *arrays: Array) -> None:
    if not all(np.isfinite(values).all() and (np.abs(values) < 1e9).all() for values in arrays):
        raise InputError(bag, topic, "numbers that are not finite, or beyond all measure")
