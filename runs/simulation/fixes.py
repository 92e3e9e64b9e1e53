"""Absolute fixes as something else might record them: noisy, sometimes grossly wrong, late or missing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import Fix, PoseBelief
from maps.poses import Array, Pose2, frozen
from runs.robot import Robot
from runs.session import RecordedFix
from runs.simulation.paths import Drive


@dataclass(frozen=True, slots=True)
class FixErrors:
    """How fixes err.

    `rate_hz`: how often. `std_m`, `std_rad`: of x and y, and of the heading; `spread`: each fix's own are
    these times a factor between 1 / spread and spread, and it says so. `position_only`: no headings.
    `outlier_share`: of gross outliers, off by `outlier_m` (from, to) and up to `outlier_rad`.
    `gaps_s`: (from, to) without fixes. `delay_s`: (least, most) from stamp to arrival.
    """

    rate_hz: float = 1.0
    std_m: float = 0.05
    std_rad: float = math.radians(1.0)
    spread: float = 1.0
    position_only: bool = False
    outlier_share: float = 0.0
    outlier_m: tuple[float, float] = (0.5, 3.0)
    outlier_rad: float = 0.5 * math.pi
    gaps_s: tuple[tuple[float, float], ...] = ()
    delay_s: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedFixes:
    """Fixes in order of their stamps, and which of them are gross outliers, (N,) bool."""

    fixes: tuple[RecordedFix, ...]
    outliers: NDArray[np.bool_]


def simulate_fixes(
    drive: Drive,
    errors: FixErrors,
    rng: np.random.Generator,
    true: Robot | None = None,
    nominal: Robot | None = None,
) -> SimulatedFixes:
    """Draw the fixes of a drive.

    With two robots, the fixes are those of a camera that sits, and whose clock runs, as the `true` one's,
    used as if it were the `nominal` one's: they err by the difference in yaw, lever arm and time offset.
    """
    stamps_ns = _stamps(drive, errors, rng)
    late_ns = 0 if true is None or nominal is None else true.time_offset_ns - nominal.time_offset_ns
    poses = drive.at(stamps_ns + late_ns)
    if true is not None and nominal is not None:
        poses = _seen_through(poses, true, nominal)
    count = len(stamps_ns)
    factors = errors.spread ** rng.uniform(-1.0, 1.0, count)
    deviations = factors[:, None] * [errors.std_m, errors.std_m, errors.std_rad]
    poses = poses + rng.normal(size=(count, 3)) * deviations
    outliers = rng.random(count) < errors.outlier_share
    poses = poses + outliers[:, None] * _blunders(count, errors, rng)
    delays_ns = np.round(rng.uniform(*errors.delay_s, count) * 1e9).astype(np.int64)
    if errors.position_only:
        deviations[:, 2] = np.inf
        poses[:, 2] = 0.0
    fixes = [
        RecordedFix(stamp, stamp + delay, Fix(PoseBelief(stamp, Pose2.from_array(pose), np.diag(std**2))))
        for stamp, delay, pose, std in zip(
            stamps_ns.tolist(), delays_ns.tolist(), poses, deviations, strict=True
        )
    ]
    outliers.setflags(write=False)
    return SimulatedFixes(tuple(fixes), outliers)


def _stamps(drive: Drive, errors: FixErrors, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the stamps of fixes, at no fixed phase of odometry's."""
    first, last = drive.stamps_ns[[0, -1]] * 1e-9
    times = np.arange(first + rng.uniform(0.0, 1.0 / errors.rate_hz), last, 1.0 / errors.rate_hz)
    for start, end in errors.gaps_s:
        times = times[(times - first < start) | (times - first >= end)]
    return np.round(times * 1e9).astype(np.int64)


def _blunders(count: int, errors: FixErrors, rng: np.random.Generator) -> Array:
    """Return gross errors (N, 3)."""
    far, way = rng.uniform(*errors.outlier_m, count), rng.uniform(-np.pi, np.pi, count)
    turned = rng.uniform(-errors.outlier_rad, errors.outlier_rad, count)
    return np.column_stack([far * np.cos(way), far * np.sin(way), turned])


def _seen_through(poses: Array, true: Robot, nominal: Robot) -> Array:
    """Return the robot's poses (N, 3) by a camera that is where `true` has it, taken to be at `nominal`'s."""
    slip = _lever(true) @ _lever(nominal).inverse()
    seen = [(Pose2.from_array(pose) @ slip).as_array() for pose in poses]
    return frozen(np.array(seen).reshape(-1, 3))


def _lever(robot: Robot) -> Pose2:
    """Return robot_from_camera in plan."""
    if robot.camera is None:
        raise ValueError("a robot without a camera sees nothing")
    mount = robot.camera.mount
    return Pose2(mount.x_m, mount.y_m, mount.yaw_rad)
