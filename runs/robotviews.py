"""The frames of a drive that serve a calibration: which, from where they were taken, and what they see."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from localization.drivenmotion import OdometryRecord
from localization.odometry import OdometryNoise
from maps.errors import InputError
from maps.outcomes import Fix
from maps.poses import Array, Pose2
from runs.robotproblem import View
from runs.runlog import Trajectory
from runs.runner import Progress, RunResult
from runs.session import Frame, Session
from vision.lines import extract_segments
from vision.matcher import MatcherConfig
from vision.measurements import LineMeasurements, measured_lines
from vision.projection import Projector
from vision.seenlines import look_again

logger = logging.getLogger(__name__)

#: Farther in time from any smoothed pose than this, a frame's pose is not known.
_NEAR_NS = 500_000_000
#: How far a smoothed pose may be off, [m^2, rad^2], and the chi-square gate (99.9 %) of a fix's distance from it.
_SMOOTHED = np.diag([0.01, 0.01, 0.003]) ** 2
_GATE_CHI2 = 16.27


@dataclass(frozen=True, slots=True)
class ViewConfig:
    """Which frames are used, and when what they see is believed.

    `most`: the rest of a long drive adds little but time. `apart_m`, `apart_rad`: between frames; a robot that
    stands sees the same errors again. `gate_m`, `gate_rad`: how far a frame's own pose may be from the drive's,
    round by round of matching and solving.
    """

    most: int = 150
    apart_m: float = 0.05
    apart_rad: float = 0.05
    gate_m: tuple[float, ...] = (0.1, 0.05)
    gate_rad: tuple[float, ...] = (0.03, 0.02)


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame with its lines, and its stamp by the camera's clock; `stamp_s` counts from the session's start."""

    frame: Frame
    camera_ns: int
    stamp_s: float
    lines: LineMeasurements


def record_of(session: Session) -> OdometryRecord:
    """Return the session's odometry as recorded, before any scales, seconds since the session's start."""
    odometry = session.odometry
    values = odometry.values
    if odometry.wheels is None:
        values = np.asarray(values / np.array(session.robot.twist_scales), np.float64)
    since_ns = (odometry.stamps_ns - session.start_ns).astype(np.float64)
    return OdometryRecord(since_ns * 1e-9, values, odometry.wheels is not None)


def chosen_frames(session: Session, config: ViewConfig) -> list[Frame]:
    """Return frames that are apart from each other, `most` at most, in order of time."""
    frames = sorted(session.frames, key=lambda frame: frame.stamp_ns)
    stamps_ns = session.odometry.stamps_ns
    inside = [frame for frame in frames if stamps_ns[0] <= frame.stamp_ns <= stamps_ns[-1]]
    way = _way(session, np.array([frame.stamp_ns for frame in inside], np.int64), config)
    apart = max(1.0, float(np.ptp(way)) / config.most) if len(way) else 1.0
    chosen, last = [], -np.inf
    for frame, here in zip(inside, way.tolist(), strict=True):
        if here - last >= apart:
            chosen.append(frame)
            last = here
    return chosen


def _way(session: Session, stamps_ns: NDArray[np.int64], config: ViewConfig) -> Array:
    """How far the robot has come at stamps (F,), in units of what keeps frames apart."""
    steps = [step for _, step in session.odometry.steps(OdometryNoise())]
    moved = [abs(step.forward_m) / config.apart_m + abs(step.turn_rad) / config.apart_rad for step in steps]
    ends = [step.stamp_ns for step in steps]
    way: Array = np.interp(stamps_ns, [steps[0].start_ns, *ends], np.append(0.0, np.cumsum(moved)))
    return way


def taken(session: Session, frames: Sequence[Frame], config: MatcherConfig, progress: Progress) -> list[Shot]:
    """Extract the lines of frames, without those that cannot be read; InputError where one has another size."""
    camera = session.camera
    assert camera is not None
    shots = []
    for done, frame in enumerate(frames, start=1):
        progress(done, len(frames))
        try:
            image = frame.image()
        except InputError as error:
            logger.warning("left out: %s", error)
            continue
        if image.shape != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} px, by robot.yaml {camera.width} x {camera.height}"
            raise InputError(frame.path, "", size)
        segments = extract_segments(image, camera, config.lines)
        lines = measured_lines(segments, camera.focal_px, config.refinement.edge_model_px)
        camera_ns = frame.stamp_ns - session.robot.time_offset_ns
        shots.append(Shot(frame, camera_ns, (camera_ns - session.start_ns) * 1e-9, lines))
    return shots


def trusted_poses(result: RunResult, session: Session, shots: Sequence[Shot]) -> dict[int, Array]:
    """Return the smoothed poses (3,) of shots, by their number, whose own fix was accepted and agrees with them."""
    track = result.trajectories.smoothed
    accepted = {
        record.filename: outcome.belief
        for record, outcome in zip(result.records, result.outcomes, strict=True)
        if record.accepted and isinstance(outcome, Fix)
    }
    poses = {}
    for number, shot in enumerate(shots):
        fix = accepted.get(shot.frame.filename)
        at = _pose_at(track, shot.camera_ns + session.robot.time_offset_ns)
        if fix is None or at is None:
            continue
        away = at.minus(fix.pose)
        if away @ np.linalg.solve(fix.covariance + _SMOOTHED, away) <= _GATE_CHI2:
            poses[number] = at.as_array()
    return poses


def _pose_at(track: Trajectory, stamp_ns: int) -> Pose2 | None:
    """Return the pose at a stamp, linear between the track's; None where none of them is near in time."""
    row = int(np.clip(np.searchsorted(track.stamps_ns, stamp_ns), 1, len(track) - 1))
    before, after = int(track.stamps_ns[row - 1]), int(track.stamps_ns[row])
    if max(stamp_ns - before, after - stamp_ns) > _NEAR_NS:
        return None
    share = min(max((stamp_ns - before) / max(after - before, 1), 0.0), 1.0)
    first, second = (Pose2.from_array(track.poses[at]) for at in (row - 1, row))
    return Pose2.from_array(first.as_array() + share * second.minus(first))


def views_of(
    shots: Sequence[Shot],
    poses: Mapping[int, Array],
    projector: Projector,
    config: MatcherConfig,
    gate: tuple[float, float],
) -> dict[int, View]:
    """Match shots from where they were taken; by number those that agree with that, within the gate (m, rad)."""
    views = {}
    for number, pose in poses.items():
        shot = shots[number]
        looked = look_again(projector, shot.lines, Pose2.from_array(pose), config.refinement)
        if looked is None:
            continue
        best, seen = looked
        enough = (
            best.score >= config.decision.min_score and best.matched_segments >= config.decision.min_matched
        )
        away = np.abs(best.belief.pose.minus(Pose2.from_array(pose)))
        if enough and np.hypot(away[0], away[1]) <= gate[0] and away[2] <= gate[1]:
            views[number] = View(shot.stamp_s, best.belief.pose.as_array(), seen)
    return views
