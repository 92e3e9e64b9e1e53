"""Sessions in memory: a drive, its odometry and its fixes, as the runner takes them; no files."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from localization.odometry import WheelGeometry
from maps.poses import Pose2
from runs.robot import Robot, Start
from runs.session import Odometry, RecordedFix, Session
from runs.simulation.fixes import FixErrors, simulate_fixes
from runs.simulation.freefloor import FreeFloor
from runs.simulation.manoeuvres import Motion
from runs.simulation.mishaps import Mishaps
from runs.simulation.offsets import Offsets, true_robot
from runs.simulation.paths import Drive, DriveKind, simulate_drive
from runs.simulation.wheels import (
    BASELINE_M,
    NOTHING,
    TwistErrors,
    WheelErrors,
    simulate_encoders,
    simulate_twists,
)

#: A robot without a camera, for studies that need none.
PLAIN_ROBOT = Robot(Path("robot.yaml"), WheelGeometry(0.05, 0.05, 0.34), None, 0, None)


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """What to simulate. `odometry` says by its type whether there are encoders or twists.

    `offsets`: how far the robot may be from its file, drawn anew for each session.
    `initial_std`: how well the start is known: x and y [m], heading [rad].
    """

    seconds: float = 60.0
    kind: DriveKind = DriveKind.MIXED
    motion: Motion = field(default_factory=Motion)
    odometry: WheelErrors | TwistErrors = field(default_factory=WheelErrors)
    offsets: Offsets = field(default_factory=lambda: Offsets(0.005, 0.005, 0.005))
    fixes: FixErrors = field(default_factory=FixErrors)
    initial_std: tuple[float, float, float] = (0.05, 0.05, math.radians(2.0))


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticSession:
    """A session with what nobody but the evaluation knows: the drive, the true robot, the outliers (N,)."""

    session: Session
    drive: Drive
    robot: Robot
    outliers: NDArray[np.bool_]


def simulate_session(
    rng: np.random.Generator,
    plan: SessionPlan,
    nominal: Robot = PLAIN_ROBOT,
    floor: FreeFloor | None = None,
    name: str = "simulated",
) -> SyntheticSession:
    """Draw a session of fixes; ValueError where encoders are asked of a robot without wheels."""
    robot = true_robot(nominal, plan.offsets.drawn(rng))
    drive = simulate_drive(rng, plan.seconds, plan.kind, floor, plan.motion)
    odometry = simulate_odometry(drive, robot, nominal, plan.odometry, rng)
    through = (robot, nominal) if nominal.camera is not None else (None, None)
    fixes = simulate_fixes(drive, plan.fixes, rng, *through)
    session = session_of(name, drive, odometry, nominal, plan.initial_std, rng, fixes.fixes)
    return SyntheticSession(session, drive, robot, fixes.outliers)


def simulate_odometry(
    drive: Drive,
    true: Robot,
    nominal: Robot,
    errors: WheelErrors | TwistErrors,
    rng: np.random.Generator,
    mishaps: Mishaps = NOTHING,
) -> Odometry:
    """Return what the robot's odometry makes of a drive; ValueError where it has no wheels for encoders."""
    if isinstance(errors, TwistErrors):
        baseline_m = true.wheels.baseline_m if true.wheels else BASELINE_M
        return simulate_twists(drive, errors, rng, mishaps, baseline_m)
    if true.wheels is None or nominal.wheels is None:
        raise ValueError("encoders need wheels")
    return simulate_encoders(drive, true.wheels, nominal.wheels, errors, rng, mishaps)


def session_of(
    name: str,
    drive: Drive,
    odometry: Odometry,
    nominal: Robot,
    initial_std: tuple[float, float, float],
    rng: np.random.Generator,
    fixes: tuple[RecordedFix, ...] = (),
) -> Session:
    """Return the session of what was simulated; its start is off by as much as its deviations say."""
    initial = start_of(drive, initial_std, rng).at(int(drive.stamps_ns[0]))
    return Session(
        name=name,
        folder=Path(name),
        robot=nominal,
        wire_map=None,
        map_path=None,
        odometry=odometry,
        frames=(),
        fixes=fixes,
        start_ns=initial.stamp_ns,
        initial=initial,
    )


def start_of(drive: Drive, initial_std: tuple[float, float, float], rng: np.random.Generator) -> Start:
    """Draw what is known of a drive's first pose."""
    pose = Pose2.from_array(drive.poses[0] + rng.normal(size=3) * initial_std)
    return Start(pose, *initial_std)
