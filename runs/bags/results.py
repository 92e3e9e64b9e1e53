"""What a run found out, as an MCAP file for the tools of ROS: Foxglove, rviz, PlotJuggler, `ros2 bag play`.

    /wireloc/pose       the filtered belief after every odometry step, with covariance, in `map`
    /wireloc/fix        every fix, accepted or not
    /wireloc/smoothed   the smoothed poses, with covariance
    /odom               dead reckoning, in `odom`
    /tf                 odom in map (REP-105), the robot in odom
    /tf_static          the camera on the robot
    /diagnostics        what became of every frame or recorded fix, and why

Every message's times are those of what it tells of.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from maps.errors import InputError
from maps.outcomes import Outcome, PoseBelief, SearchWindow
from maps.poses import Pose2
from runs.bags.bagfile import BagFile, BagKind, covariance_fields, header, pose_fields, transform_fields
from runs.bags.opening import require_rosbags
from runs.bags.topics import ODOMETRY, POSE, TRANSFORMS
from runs.bags.writing import BASE_FRAME, Message, mount_fields
from runs.config import RunConfig
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.session import Frame, Session
from runs.spool import Shelf

MAP_FRAME, ODOM_FRAME = "map", "odom"
_DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TOPICS = {
    "/wireloc/pose": POSE,
    "/wireloc/fix": POSE,
    "/wireloc/smoothed": POSE,
    "/odom": ODOMETRY,
    "/tf": TRANSFORMS[0],
    "/tf_static": TRANSFORMS[0],
    "/diagnostics": _DIAGNOSTICS,
}
#: How bad a state is, in the numbers of DiagnosticStatus.
_LEVELS = {"TRACKING": 0, "UNCERTAIN": 1, "LOST": 2}
_TOLD = ("outcome", "reason", "verdict", "nis", "segments", "matches", "extract_ms", "match_ms", "update_ms")


class McapLog:
    """Write a run's results when it is over; a `runs.runlog.RunLog`."""

    def __init__(self, path: Path) -> None:
        """MissingExtraError without rosbags."""
        require_rosbags()
        self._path = path
        self._session: Session | None = None
        self._records: Shelf[StepRecord] = Shelf()

    def begin(self, session: Session, config: RunConfig) -> None:  # noqa: ARG002 - it is in config.yaml
        """Refuse what an MCAP file cannot hold: InputError."""
        if session.start_ns < 0:
            raise InputError(session.folder, "", "times before zero have no place in an MCAP file")
        self._session = session

    def step(
        self,
        record: StepRecord,
        frame: Frame | None,  # noqa: ARG002 - pictures are in the session
        outcome: Outcome,  # noqa: ARG002 - the trajectory has the fixes
        window: SearchWindow | None,  # noqa: ARG002
    ) -> None:
        """Keep the record for the diagnostics."""
        self._records.append(record)

    def belief(self, belief: PoseBelief) -> None:
        """Wait for the trajectory."""

    def finish(self, trajectories: Trajectories) -> None:
        """Write the file, whole or not at all."""
        records = sorted(self._records, key=lambda record: record.stamp_ns)
        with BagFile(self._path, BagKind.MCAP) as bag:
            for topic, msgtype in TOPICS.items():
                bag.add(topic, msgtype, latched=topic == "/tf_static")
            if self._session is not None and self._session.camera is not None:
                start_ns = self._session.start_ns
                mount = mount_fields(self._session.camera, start_ns)
                bag.write("/tf_static", start_ns, {"transforms": [mount]})
            streams = (
                _poses("/wireloc/pose", trajectories.filtered),
                _poses("/wireloc/fix", trajectories.vision),
                _poses("/wireloc/smoothed", trajectories.smoothed),
                _reckoning(trajectories.odometry),
                _corrections(trajectories),
                map(_diagnosis, records),
            )
            for topic, stamp_ns, fields in heapq.merge(*streams, key=itemgetter(1)):
                bag.write(topic, stamp_ns, fields)


def _poses(topic: str, track: Trajectory) -> Iterator[Message]:
    covariances = track.covariances if track.covariances is not None else np.zeros((len(track), 3, 3))
    for stamp_ns, pose, covariance in zip(track.stamps_ns.tolist(), track.poses, covariances, strict=True):
        known = {"pose": pose_fields(Pose2.from_array(pose)), "covariance": covariance_fields(covariance)}
        yield topic, stamp_ns, {"header": header(stamp_ns, MAP_FRAME), "pose": known}


def _reckoning(track: Trajectory) -> Iterator[Message]:
    for stamp_ns, row in zip(track.stamps_ns.tolist(), track.poses, strict=True):
        fields = {
            "header": header(stamp_ns, ODOM_FRAME),
            "child_frame_id": BASE_FRAME,
            "pose": {"pose": pose_fields(Pose2.from_array(row))},
        }
        yield "/odom", stamp_ns, fields


def _corrections(trajectories: Trajectories) -> Iterator[Message]:
    """Yield where odometry's frame is in the map, while that is known, and the robot in odometry's frame."""
    filtered = trajectories.filtered
    beliefs = dict(zip(filtered.stamps_ns.tolist(), filtered.poses, strict=True))
    odometry = trajectories.odometry
    for stamp_ns, row in zip(odometry.stamps_ns.tolist(), odometry.poses, strict=True):
        odom_from_robot = Pose2.from_array(row)
        told = [transform_fields(stamp_ns, ODOM_FRAME, BASE_FRAME, odom_from_robot)]
        if stamp_ns in beliefs:
            map_from_odom = Pose2.from_array(beliefs[stamp_ns]) @ odom_from_robot.inverse()
            told.append(transform_fields(stamp_ns, MAP_FRAME, ODOM_FRAME, map_from_odom))
        yield "/tf", stamp_ns, {"transforms": told}


def _diagnosis(record: StepRecord) -> Message:
    values = {name: getattr(record, name) for name in _TOLD}
    status: dict[str, Any] = {
        "level": _LEVELS[record.state],
        "name": "wireloc: localization",
        "message": " ".join(
            word for word in (record.state, record.outcome, record.reason, record.verdict) if word
        ),
        "hardware_id": record.filename,
        "values": [{"key": key, "value": str(of)} for key, of in values.items() if of not in (None, "")],
    }
    return "/diagnostics", record.stamp_ns, {"header": header(record.stamp_ns, ""), "status": [status]}
