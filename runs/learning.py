"""Learning a map's detection rates, polarity and accuracy from runs through it, without any truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.mapdocument import MapDocument
from maps.poses import Array, Pose2, wrap_angle
from maps.wiremap import WireMap
from runs.folder import Step, read_steps, read_tum, to_ns
from runs.opening import Reading, open_session
from runs.runlog import ACCEPTED, Trajectory
from runs.session import Frame, Session
from vision.lines import LineConfig, extract_segments
from vision.maplearning import LearntMap
from vision.mapsightings import SightingConfig, Sightings, sightings_of
from vision.projection import Projector

#: A frame's smoothed pose is trusted this near in time to a fix that the smoothed track passes through.
NEAR_NS = 2_000_000_000
AGREES_M, AGREES_RAD = 0.15, math.radians(2.0)
#: A frame nearer than this to the last one used shows nothing new.
MOVED_M, TURNED_RAD = 0.10, math.radians(3.0)
#: Decimals of what is written: more would be false.
DECIMALS = 3

#: Called after every frame with how many are done, and of how many.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A smoothed run and the session that it was a run of: frames that may be learnt from, with their poses."""

    name: str
    session: Session
    frames: tuple[tuple[Frame, Pose2], ...]
    lines: LineConfig


def read_drive(
    run: Path, map_path: Path, session: Path | None = None, reading: Reading | None = None
) -> Drive:
    """Read a run folder and its session; `session` where the run's configuration does not find it any more.

    `reading`: how to read a session that is no folder; its map is `map_path`. InputError names the file, and the
    line, key or topic, of what is missing or cannot be.
    """
    if not run.is_dir():
        raise InputError(run, "", "no such run folder")
    path = run / "config.yaml"
    content = read_yaml(path)
    if session is None:
        folder = _inside(content, "run", "folder")
        if not isinstance(folder, str):
            raise InputError(path, "run.folder", "missing: name the session with --session")
        session = Path(folder)
        if not session.exists():
            raise InputError(
                path, "run.folder", f"no folder or bag {session}: name the session with --session"
            )
    drive = open_session(session, replace(reading or Reading(), map_path=map_path))
    if not drive.frames:
        raise InputError(session, "", "no images to learn from")
    lines = checked(LineConfig, _inside(content, "matcher", "lines") or {}, path)
    frames = trusted_frames(drive.frames, read_tum(run / "smoothed.tum"), read_steps(run))
    return Drive(run.resolve().name, drive, frames, lines)


def trusted_frames(
    frames: Sequence[Frame], smoothed: Trajectory, steps: Sequence[Step]
) -> tuple[tuple[Frame, Pose2], ...]:
    """Return the frames near accepted fixes that the smoothed track confirms, each with its smoothed pose."""
    accepted = [step for step in steps if step["verdict"] in ACCEPTED and step["fix_phi_rad"]]
    stamps = np.array([to_ns(step["timestamp_s"]) for step in accepted], np.int64)
    fixes = np.array(
        [[float(step[f"fix_{name}"]) for name in ("x_m", "y_m", "phi_rad")] for step in accepted]
    )
    if not len(smoothed) or not len(stamps):
        return ()
    away = fixes - _at(smoothed, stamps)
    agree = np.hypot(away[:, 0], away[:, 1]) < AGREES_M
    agree &= np.abs(wrap_angle(away[:, 2])) < AGREES_RAD
    good = stamps[agree]
    chosen: list[tuple[Frame, Pose2]] = []
    for frame in sorted(frames, key=lambda frame: frame.stamp_ns):
        within = smoothed.stamps_ns[0] <= frame.stamp_ns <= smoothed.stamps_ns[-1]
        if not within or not (np.abs(good - frame.stamp_ns) <= NEAR_NS).any():
            continue
        pose = Pose2.from_array(_at(smoothed, np.array([frame.stamp_ns]))[0])
        if not chosen or _apart(pose, chosen[-1][1]):
            chosen.append((frame, pose))
    return tuple(chosen)


def gather(
    wire_map: WireMap, drives: Sequence[Drive], progress: Progress
) -> tuple[Sightings | None, list[int]]:
    """Look at every trusted frame of some drives; what was seen, None if nothing, and how many frames each gave."""
    total, done = sum(len(drive.frames) for drive in drives), 0
    parts: list[Sightings] = []
    used: list[int] = []
    for drive in drives:
        camera = drive.session.camera
        assert camera is not None
        projector, config = Projector(camera, wire_map), SightingConfig(lines=drive.lines)
        before = len(parts)
        for frame, pose in drive.frames:
            image = frame.image()
            if image.shape != (camera.height, camera.width):
                size = (
                    f"{image.shape[1]} x {image.shape[0]} px, by robot.yaml {camera.width} x {camera.height}"
                )
                raise InputError(frame.path, "", size)
            segments = extract_segments(image, camera, drive.lines)
            seen = sightings_of(projector, pose, segments, len(parts), config)
            if seen is not None:
                parts.append(seen)
            done += 1
            progress(done, total)
        used.append(len(parts) - before)
    return (Sightings.joined(parts) if parts else None), used


def written(document: MapDocument, learnt: LearntMap) -> MapDocument:
    """Return the map with what was learnt; what was not keeps what it had."""
    segments = []
    for row, segment in enumerate(document.segments):
        known: dict[str, Any] = {}
        if np.isfinite(learnt.detection_rate[row]):
            known["detection_rate"] = round(float(learnt.detection_rate[row]), DECIMALS)
        if np.isfinite(learnt.polarity_share[row]) and learnt.polarity[row]:
            known["polarity"] = int(learnt.polarity[row])
        if np.isfinite(learnt.sigma_m[row]):
            known["sigma_m"] = round(float(learnt.sigma_m[row]), DECIMALS + 1)
        segments.append(segment.model_copy(update=known))
    return document.model_copy(update={"segments": segments})


def _at(track: Trajectory, stamps_ns: Any) -> Array:
    """The track's poses at some times (K,), in between its own: (K, 3)."""
    start = track.stamps_ns[0]
    times, own = (stamps_ns - start).astype(np.float64), (track.stamps_ns - start).astype(np.float64)
    columns = (*track.poses[:, :2].T, np.unwrap(track.poses[:, 2]))
    return np.column_stack([np.interp(times, own, column) for column in columns])


def _apart(pose: Pose2, other: Pose2) -> bool:
    x, y, phi = pose.minus(other)
    return math.hypot(x, y) >= MOVED_M or abs(phi) >= TURNED_RAD


def _inside(content: dict[str, Any], *keys: str) -> Any:
    """What lies under nested keys; None where there is nothing."""
    value: Any = content
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value
