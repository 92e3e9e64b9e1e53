"""A session of any origin, written as a session folder."""

from __future__ import annotations

import csv
import math
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from maps.documents import read_text, read_yaml
from runs.bags.opening import is_bag
from runs.results import StagedFolder, seconds
from runs.robot import DISTORTION_KEYS, Robot, Start
from runs.robotfile import with_block
from runs.session import TWIST_COLUMNS, WHEEL_COLUMNS, Session
from runs.tables import Times
from vision.camera import Camera
from vision.rawimages import kept_file

#: What the evaluation alone reads; it goes along as it is.
TRUTH = ("ground_truth.csv", "ground_truth_dense.csv")

Progress = Callable[[int, int], None]


def write_folder(session: Session, out: Path, progress: Progress) -> None:
    """Write a session as a folder that reads back the same; there whole, or not at all.

    InputError where `out` holds something already, or an image cannot be read.
    """
    with StagedFolder(out) as folder:
        (folder / "robot.yaml").write_text(robot_text(session.robot), encoding="utf-8")
        copy_beside(session, folder)
        write_odometry(folder / "odometry.csv", session)
        if session.fixes:
            write_fixes(folder / "fixes.csv", session)
        if session.frames:
            _write_frames(folder, session, progress)


def copy_beside(session: Session, folder: Path) -> None:
    """Copy the map, and the truth where there is one."""
    if session.map_path is not None:
        shutil.copyfile(session.map_path, folder / "map.yaml")
    for name in TRUTH:
        if (session.folder / name).is_file():
            shutil.copyfile(session.folder / name, folder / name)


def robot_text(robot: Robot) -> str:
    """Return the robot file's text, with what was found elsewhere added to it."""
    text, known = ("", {}) if is_bag(robot.path) else (read_text(robot.path), read_yaml(robot.path))
    added: dict[str, dict[str, Any]] = {}
    if robot.camera is not None and not known.get("camera"):
        added["camera"] = _camera_keys(robot.camera)
    if robot.start is not None and not known.get("initial_pose"):
        added["initial_pose"] = _start_keys(robot.start)
    if not text:
        return str(yaml.safe_dump(added, sort_keys=False))
    for block, values in added.items():
        text = with_block(text, block, values)
    return text


def raw_values(session: Session) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return odometry's values as they were recorded, before the robot's scales, (N, 2)."""
    if session.odometry.wheels is not None:
        return session.odometry.values
    return session.odometry.values / session.robot.twist_scales


def _camera_keys(camera: Camera) -> dict[str, Any]:
    mount = camera.mount
    names = ("x_m", "y_m", "height_m", "pitch_down_rad", "yaw_rad", "roll_rad")
    return {
        "model": camera.model.value,
        **{name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
        DISTORTION_KEYS[camera.model][0]: camera.distortion.tolist(),
        "mount": {name: float(getattr(mount, name)) for name in names},
    }


def _start_keys(start: Start) -> dict[str, Any]:
    keys = {"x_m": start.pose.x, "y_m": start.pose.y, "std_x_m": start.std_x_m, "std_y_m": start.std_y_m}
    if math.isfinite(start.std_phi_rad):
        keys |= {"phi_rad": start.pose.phi, "std_phi_rad": start.std_phi_rad}
    return {key: float(value) for key, value in keys.items()}


def write_odometry(path: Path, session: Session) -> None:
    """Write odometry.csv, its values as they were recorded."""
    odometry = session.odometry
    columns = WHEEL_COLUMNS if odometry.wheels is not None else TWIST_COLUMNS
    _write(path, columns, odometry.stamps_ns, odometry.arrivals_ns, raw_values(session).tolist())


def write_fixes(path: Path, session: Session) -> None:
    """Write fixes.csv."""
    columns = ("x_m", "y_m", "phi_rad", "std_x_m", "std_y_m", "std_phi_rad")
    rows = []
    for recorded in session.fixes:
        pose, (x, y, phi) = (
            recorded.fix.belief.pose,
            np.sqrt(np.diag(recorded.fix.belief.covariance)).tolist(),
        )
        known = math.isfinite(phi)
        rows.append((pose.x, pose.y, pose.phi if known else "", x, y, phi if known else ""))
    stamps_ns = np.array([recorded.stamp_ns for recorded in session.fixes])
    _write(path, columns, stamps_ns, np.array([recorded.arrival_ns for recorded in session.fixes]), rows)


def _write_frames(folder: Path, session: Session, progress: Progress) -> None:
    stamps_ns = np.array([frame.stamp_ns for frame in session.frames]) - session.robot.time_offset_ns
    arrivals_ns = np.maximum([frame.arrival_ns for frame in session.frames], stamps_ns)
    _write(
        folder / "frames.csv",
        ("filename",),
        stamps_ns,
        arrivals_ns,
        [(of.filename,) for of in session.frames],
    )
    for done, frame in enumerate(session.frames, start=1):
        path = folder / frame.filename
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(kept_file(frame.data()))
        progress(done, len(session.frames))


def _write(
    path: Path,
    columns: tuple[str, ...],
    stamps_ns: Times,
    arrivals_ns: Times,
    rows: Iterable[Iterable[object]],
) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("timestamp_s", *columns, "arrival_s"))
        for stamp_ns, arrival_ns, cells in zip(stamps_ns.tolist(), arrivals_ns.tolist(), rows, strict=True):
            writer.writerow((seconds(stamp_ns), *cells, seconds(arrival_ns)))
