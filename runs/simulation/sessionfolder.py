"""A simulated drive as a session folder, written as a robot would have recorded it."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from maps.documents import read_text
from maps.poses import Array, Pose2
from runs.results import StagedFolder, seconds
from runs.robot import Robot, Start
from runs.robotfile import with_block
from runs.session import TWIST_COLUMNS, WHEEL_COLUMNS, Odometry, RecordedFix
from runs.simulation.filming import Filming
from runs.simulation.fixes import SimulatedFixes
from runs.simulation.mishaps import Mishaps
from runs.simulation.observable import observed
from runs.simulation.rehearsal import Recipe, Rehearsal, image_name, rehearsed
from runs.simulation.scene import scene_of
from runs.tables import Times
from vision.encoding import jpeg
from vision.images import read_image
from vision.projection import Projector

#: Called with how many frames are drawn, and of how many.
Progress = Callable[[int, int], None]
_TRUTH_COLUMNS = ("timestamp_s", "x_m", "y_m", "phi_rad")


def simulate_folder(
    out: Path,
    map_path: Path,
    robot_path: Path,
    recipe: Recipe,
    progress: Progress,
    notes: Mapping[str, object] | None = None,
) -> None:
    """Write a session folder, whole or not at all; `notes`: further YAML files by name, which nothing reads.

    InputError where the map or the robot cannot be read, the robot does not fit on the floor or lacks what
    the recipe asks for, or `out` holds something already.
    """
    known = rehearsed(map_path, robot_path, recipe)
    drive, robot = known.drive, known.robot
    with StagedFolder(out) as folder:
        shutil.copyfile(map_path, folder / "map.yaml")
        (folder / "robot.yaml").write_text(_robot_text(robot_path, known.start), encoding="utf-8")
        write_odometry(folder / "odometry.csv", known.odometry)
        _write_truth(folder / "ground_truth_dense.csv", drive.stamps_ns, drive.poses)
        if recipe.fixes is not None:
            write_fixes(folder / "fixes.csv", known.fixes.fixes)
        if recipe.frame_rate_hz > 0.0:
            way = drive.poses[::10, :2]
            scene = scene_of(known.wire_map, recipe.conditions, known.scene_rng, _eye_m(robot), way)
            filming = Filming(scene, robot, recipe.sensor, mishaps=recipe.mishaps)
            frames = filming.frames(drive, known.stamps_ns, known.picture_rng)
            _write_frames(
                folder, frames, known.stamps_ns, robot.time_offset_ns, recipe.sensor.quality, progress
            )
            _write_observable(folder, known, recipe.mishaps)
        fixes_ns = np.array([fix.stamp_ns for fix in known.fixes.fixes], np.int64)
        at = np.unique(np.concatenate([fixes_ns, known.stamps_ns]))
        _write_truth(folder / "ground_truth.csv", at, drive.at(at))
        for name, content in {"truth.yaml": _told(recipe, robot, known.fixes), **(notes or {})}.items():
            _write_yaml(folder / name, content)


def _eye_m(robot: Robot) -> float:
    return robot.camera.mount.height_m if robot.camera else 0.0


def _robot_text(path: Path, start: Start) -> str:
    """Return the robot's file, its initial pose replaced."""
    known = {
        "x_m": round(start.pose.x, 4),
        "y_m": round(start.pose.y, 4),
        "phi_rad": round(start.pose.phi, 5),
        "std_x_m": start.std_x_m,
        "std_y_m": start.std_y_m,
        "std_phi_rad": start.std_phi_rad,
    }
    return with_block(read_text(path), "initial_pose", known)


def write_odometry(path: Path, odometry: Odometry) -> None:
    """Write odometry.csv, with arrival_s where rows arrived later than they were stamped."""
    columns = WHEEL_COLUMNS if odometry.wheels is not None else TWIST_COLUMNS
    rows = [
        [seconds(stamp), *_fixed(pair)]
        for stamp, pair in zip(odometry.stamps_ns.tolist(), odometry.values.tolist(), strict=True)
    ]
    header = ["timestamp_s", *columns]
    if (odometry.arrivals_ns != odometry.stamps_ns).any():
        header.append("arrival_s")
        rows = [[*row, seconds(at)] for row, at in zip(rows, odometry.arrivals_ns.tolist(), strict=True)]
    write_rows(path, header, rows)


def _write_truth(path: Path, stamps_ns: Times, poses: Array) -> None:
    rows = zip(stamps_ns.tolist(), poses.tolist(), strict=True)
    write_rows(path, _TRUTH_COLUMNS, ((seconds(stamp), *_fixed(pose)) for stamp, pose in rows))


def write_fixes(path: Path, fixes: Iterable[RecordedFix]) -> None:
    """Write fixes.csv."""
    header = (*_TRUTH_COLUMNS, "std_x_m", "std_y_m", "std_phi_rad", "arrival_s")
    rows = []
    for fix in fixes:
        belief = fix.fix.belief
        pose, std = belief.pose.as_array(), np.sqrt(np.diag(belief.covariance))
        cells = [*_fixed(pose), *_fixed(std)]
        if not belief.measured[2]:
            cells[2] = cells[5] = ""
        rows.append((seconds(fix.stamp_ns), *cells, seconds(fix.arrival_ns)))
    write_rows(path, header, rows)


def _write_frames(
    folder: Path,
    frames: Iterable[Any],
    stamps_ns: Times,
    offset_ns: int,
    quality: int,
    progress: Progress,
) -> None:
    """Write pictures and their stamps, which are the camera's own clock's."""
    (folder / "images").mkdir()
    rows = []
    for number, (image, stamp_ns) in enumerate(zip(frames, stamps_ns.tolist(), strict=True)):
        name = image_name(number)
        (folder / name).write_bytes(jpeg(image, quality))
        rows.append((seconds(stamp_ns - offset_ns), name))
        progress(number + 1, len(stamps_ns))
    write_rows(folder / "frames.csv", ("timestamp_s", "filename"), rows)


def _write_observable(folder: Path, known: Rehearsal, mishaps: Mishaps) -> None:
    """Count in the files as written what their map edges show, from where they were taken."""
    assert known.robot.camera is not None
    projector, rows = Projector(known.robot.camera, known.wire_map), []
    for number, (stamp_ns, pose) in enumerate(
        zip(known.stamps_ns.tolist(), known.drive.at(known.stamps_ns), strict=True)
    ):
        camera = mishaps.camera_at(known.robot.camera, stamp_ns)
        if camera.mount != projector.camera.mount:
            projector = Projector(camera, known.wire_map)
        name = image_name(number)
        seen = observed(read_image(folder / name), projector, Pose2.from_array(pose))
        rows.append((name, str(seen.visible), str(seen.observable)))
    write_rows(folder / "observable.csv", ("filename", "visible", "observable"), rows)


def write_rows(path: Path, header: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Write a CSV file as the session's reader takes it."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([tuple(header), *rows])


def _fixed(values: Iterable[float]) -> list[str]:
    return [f"{value:.7f}" for value in values]


def _told(recipe: Recipe, robot: Robot, fixes: SimulatedFixes) -> dict[str, Any]:
    """Return what the simulator knows and the robot does not."""
    told: dict[str, Any] = {"recipe": asdict(recipe)}
    if robot.wheels is not None:
        told["wheels"] = asdict(robot.wheels)
    if robot.camera is not None:
        told["mount"] = asdict(robot.camera.mount)
    told["time_offset_s"] = robot.time_offset_ns / 1e9
    told["outliers"] = np.flatnonzero(fixes.outliers).tolist()
    return told


def _write_yaml(path: Path, content: object) -> None:
    path.write_text(yaml.safe_dump(_plain(content), sort_keys=False), encoding="utf-8")


def _plain(value: Any) -> Any:
    match value:
        case dict():
            return {key: _plain(part) for key, part in value.items()}
        case list() | tuple():
            return [_plain(part) for part in value]
        case np.generic():
            return value.item()
    return value
