"""A simulated drive before anything is written: all but the pictures, and where and when they will be taken."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from maps.errors import InputError
from maps.mapfile import read_map
from maps.wiremap import WireMap
from runs.robot import Robot, Start, read_robot
from runs.session import Frame, Odometry, Session
from runs.simulation.filming import frame_stamps
from runs.simulation.fixes import FixErrors, SimulatedFixes, simulate_fixes
from runs.simulation.freefloor import FreeFloor, NoRoomError
from runs.simulation.manoeuvres import Motion
from runs.simulation.mishaps import Mishaps
from runs.simulation.offsets import CALIBRATED, Offsets, true_robot
from runs.simulation.paths import Drive, simulate_drive
from runs.simulation.photograph import Sensor
from runs.simulation.scene import Conditions
from runs.simulation.synthetic import simulate_odometry, start_of
from runs.simulation.wheels import TwistErrors, WheelErrors
from runs.tables import Times


@dataclass(frozen=True, slots=True)
class Recipe:
    """What to simulate. The same recipe gives the same session.

    `radius_m`: of the robot's outline. `frame_rate_hz`: 0 for no frames. `fixes`: None for none.
    `offsets`: how far the robot may be from its file. `initial_std`: how well its start is known [m, m, rad].
    `mishaps`: what goes wrong on the way.
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
    mishaps: Mishaps = field(default_factory=Mishaps)


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """What is known of a session before its pictures are taken.

    `nominal`: the robot by its file, `robot` as it truly is. `stamps_ns`: (K,) of the frames, on odometry's clock.
    `scene_rng`, `picture_rng`: what building and pictures draw from.
    """

    map_path: Path
    wire_map: WireMap
    nominal: Robot
    robot: Robot
    drive: Drive
    odometry: Odometry
    start: Start
    fixes: SimulatedFixes
    stamps_ns: Times
    scene_rng: np.random.Generator
    picture_rng: np.random.Generator

    def session(self, folder: Path) -> Session:
        """Return the session that will lie in a folder, its pictures not there yet."""
        late_ns = self.robot.time_offset_ns - self.nominal.time_offset_ns
        names = [image_name(number) for number in range(len(self.stamps_ns))]
        frames = tuple(
            Frame(stamp_ns - late_ns, stamp_ns - late_ns, name, folder / name)
            for stamp_ns, name in zip(self.stamps_ns.tolist(), names, strict=True)
        )
        looks_ns = [frame.stamp_ns for frame in frames] + [fix.stamp_ns for fix in self.fixes.fixes]
        start_ns = min(int(self.odometry.stamps_ns[0]), *looks_ns)
        return Session(
            name=folder.name,
            folder=folder,
            robot=self.nominal,
            wire_map=self.wire_map,
            map_path=self.map_path,
            odometry=self.odometry,
            frames=frames,
            fixes=self.fixes.fixes,
            start_ns=start_ns,
            initial=self.start.at(start_ns),
        )


def rehearsed(map_path: Path, robot_path: Path, recipe: Recipe) -> Rehearsal:
    """Simulate a session but for its pictures, in a moment.

    InputError where the map or the robot cannot be read, the robot does not fit on the floor, or lacks what the
    recipe asks for.
    """
    wire_map, nominal = read_map(map_path), read_robot(robot_path)
    _check(nominal, recipe)
    # Each part has its own numbers: with or without pictures, or mishaps, the drive is the same.
    draw = [np.random.default_rng(seed) for seed in np.random.SeedSequence(recipe.seed).spawn(6)]
    robot = true_robot(nominal, recipe.offsets.drawn(draw[0]))
    floor = _free_floor(wire_map, map_path, recipe)
    drive = simulate_drive(draw[1], recipe.seconds, floor=floor, motion=recipe.motion)
    odometry = simulate_odometry(drive, robot, nominal, recipe.odometry, draw[2], recipe.mishaps)
    start = start_of(drive, recipe.initial_std, draw[2])
    fixes = SimulatedFixes((), np.zeros(0, bool))
    if recipe.fixes is not None:
        through = (robot, nominal) if nominal.camera else (None, None)
        fixes = simulate_fixes(drive, recipe.fixes, draw[3], *through)
    stamps_ns: Times = np.zeros(0, np.int64)
    if recipe.frame_rate_hz > 0.0:
        stamps_ns = frame_stamps(drive, recipe.frame_rate_hz, draw[4])
    return Rehearsal(
        map_path, wire_map, nominal, robot, drive, odometry, start, fixes, stamps_ns, draw[4], draw[5]
    )


def image_name(number: int) -> str:
    """Return the name, in its session, of the frame of that number."""
    return f"images/{number:06d}.jpg"


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
