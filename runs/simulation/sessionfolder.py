"""A simulated drive as a session folder, written as a robot would have recorded it."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from maps.documents import read_text
from maps.errors import InputError
from maps.mapfile import read_map
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.results import StagedFolder, seconds
from runs.robot import Robot, Start, read_robot
from runs.robotfile import with_block
from runs.session import TWIST_COLUMNS, WHEEL_COLUMNS, Odometry, RecordedFix
from runs.simulation.filming import Filming, frame_stamps
from runs.simulation.fixes import FixErrors, SimulatedFixes, simulate_fixes
from runs.simulation.freefloor import FreeFloor, NoRoomError
from runs.simulation.manoeuvres import Motion
from runs.simulation.observable import observed
from runs.simulation.offsets import CALIBRATED, Offsets, true_robot
from runs.simulation.paths import simulate_drive
from runs.simulation.photograph import Sensor
from runs.simulation.scene import Conditions, scene_of
from runs.simulation.synthetic import simulate_odometry, start_of
from runs.simulation.wheels import TwistErrors, WheelErrors
from runs.tables import Times
from vision.encoding import jpeg
from vision.images import read_image
from vision.projection import Projector

#: Called with how many frames are drawn, and of how many.
Progress = Callable[[int, int], None]
_TRUTH_COLUMNS = ("timestamp_s", "x_m", "y_m", "phi_rad")


@dataclass(frozen=True, slots=True)
class Recipe:
    """What to simulate. The same recipe gives the same session.

    `radius_m`: of the robot's outline. `frame_rate_hz`: 0 for no frames. `fixes`: None for none.
    `offsets`: how far the robot may be from its file. `initial_std`: how well its start is known [m, m, rad].
    """

    seed: int = 0
    seconds: float = 60.0
    radius_m: float = 0.25
    motion: Motion = field(default_factory=Motion)
    odometry: WheelErrors | TwistErrors = field(default_factory=WheelErrors)
    offsets: Offsets = CALIBRATED
    frame_rate_hz: float = 1.0
    conditions: Conditions = field(default_factory=Conditions)
    sensor: Sensor = field(default_factory=Sensor)
    fixes: FixErrors | None = None
    initial_std: tuple[float, float, float] = (0.05, 0.05, 0.035)


def simulate_folder(out: Path, map_path: Path, robot_path: Path, recipe: Recipe, progress: Progress) -> None:
    """Write a session folder, whole or not at all.

    InputError where the map or the robot cannot be read, the robot does not fit on the floor or lacks what
    the recipe asks for, or `out` holds something already.
    """
    wire_map, nominal = read_map(map_path), read_robot(robot_path)
    _check(nominal, recipe)
    # Each part has its own numbers: with or without pictures, the drive is the same.
    draw = [np.random.default_rng(seed) for seed in np.random.SeedSequence(recipe.seed).spawn(6)]
    robot = true_robot(nominal, recipe.offsets.drawn(draw[0]))
    drive = simulate_drive(
        draw[1], recipe.seconds, floor=_free_floor(wire_map, map_path, recipe), motion=recipe.motion
    )
    odometry = simulate_odometry(drive, robot, nominal, recipe.odometry, draw[2])
    start = start_of(drive, recipe.initial_std, draw[2])
    with StagedFolder(out) as folder:
        shutil.copyfile(map_path, folder / "map.yaml")
        (folder / "robot.yaml").write_text(_robot_text(robot_path, start), encoding="utf-8")
        write_odometry(folder / "odometry.csv", odometry)
        _write_truth(folder / "ground_truth_dense.csv", drive.stamps_ns, drive.poses)
        looks: list[Times] = []
        fixes = SimulatedFixes((), np.zeros(0, bool))
        if recipe.fixes is not None:
            through = (robot, nominal) if nominal.camera else (None, None)
            fixes = simulate_fixes(drive, recipe.fixes, draw[3], *through)
            write_fixes(folder / "fixes.csv", fixes.fixes)
            looks.append(np.array([fix.stamp_ns for fix in fixes.fixes], np.int64))
        if recipe.frame_rate_hz > 0.0:
            stamps_ns = frame_stamps(drive, recipe.frame_rate_hz, draw[4])
            scene = scene_of(wire_map, recipe.conditions, draw[4], _eye_m(robot), drive.poses[::10, :2])
            frames = Filming(scene, robot, recipe.sensor).frames(drive, stamps_ns, draw[5])
            _write_frames(folder, frames, stamps_ns, robot.time_offset_ns, recipe.sensor.quality, progress)
            _write_observable(folder, robot, wire_map, drive.at(stamps_ns))
            looks.append(stamps_ns)
        at = np.unique(np.concatenate(looks))
        _write_truth(folder / "ground_truth.csv", at, drive.at(at))
        _write_yaml(folder / "truth.yaml", _told(recipe, robot, fixes))


def _check(nominal: Robot, recipe: Recipe) -> None:
    if recipe.frame_rate_hz <= 0.0 and recipe.fixes is None:
        raise InputError("--frame-rate", "", "0, and no fixes: nothing to localize with")
    if recipe.frame_rate_hz > 0.0 and nominal.camera is None:
        raise InputError(nominal.path, "camera", "missing, and frames are asked for")
    if isinstance(recipe.odometry, WheelErrors) and nominal.wheels is None:
        raise InputError(nominal.path, "wheels", "missing, and wheel angles are asked for")


def _free_floor(wire_map: WireMap, map_path: Path, recipe: Recipe) -> FreeFloor:
    try:
        return FreeFloor.of(wire_map.floor, recipe.radius_m, wire_map.lintels.mean(axis=1))
    except NoRoomError as error:
        raise InputError(map_path, "floor", str(error)) from None


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
        name = _image_name(number)
        (folder / name).write_bytes(jpeg(image, quality))
        rows.append((seconds(stamp_ns - offset_ns), name))
        progress(number + 1, len(stamps_ns))
    write_rows(folder / "frames.csv", ("timestamp_s", "filename"), rows)


def _write_observable(folder: Path, robot: Robot, wire_map: WireMap, poses: Array) -> None:
    """Count in the files as written what their map edges show, from where they were taken."""
    assert robot.camera is not None
    projector, rows = Projector(robot.camera, wire_map), []
    for number, pose in enumerate(poses):
        seen = observed(read_image(folder / _image_name(number)), projector, Pose2.from_array(pose))
        rows.append((_image_name(number), str(seen.visible), str(seen.observable)))
    write_rows(folder / "observable.csv", ("filename", "visible", "observable"), rows)


def _image_name(number: int) -> str:
    return f"images/{number:06d}.jpg"


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


def _write_yaml(path: Path, content: dict[str, Any]) -> None:
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
