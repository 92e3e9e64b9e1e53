"""Drives with measured lines but no pictures: what a calibration gets, drawn from a robot that nobody knows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from localization.drivenmotion import OdometryRecord
from localization.odometry import OdometryNoise, WheelGeometry
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.robot import Robot
from runs.robotproblem import NoiseModel, Prior, Problem, View
from runs.session import Odometry
from runs.simulation.freefloor import FreeFloor
from runs.simulation.offsets import UNCALIBRATED, Offsets, true_robot
from runs.simulation.paths import DriveKind, simulate_drive
from runs.simulation.synthetic import simulate_odometry
from runs.simulation.wheels import TwistErrors, WheelErrors
from vision.camera import Camera, CameraModel, CameraMount
from vision.projection import Projector
from vision.seenlines import MapLines, SeenLines, mount_values

CAMERA = Camera(
    model=CameraModel.PINHOLE_RADTAN,
    width=640,
    height=480,
    fx=560.0,
    fy=560.0,
    cx=319.5,
    cy=239.5,
    distortion=np.zeros(5),
    mount=CameraMount(x_m=0.12, height_m=1.1, pitch_down_rad=0.1),
)
NOMINAL = Robot(Path("robot.yaml"), WheelGeometry(0.05, 0.05, 0.34), CAMERA, 0, None)
#: Deviations that such a robot is given: tape measure, spirit level, a guess.
STD = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.0005, 0.0005, 0.0034, 0.05])
#: Noise of a line's end across the line.
END_PX = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredDrive:
    """A calibration problem, and the answer: the robot's true parameters (10,)."""

    problem: Problem
    truth: Array


def measured_drive(
    rng: np.random.Generator,
    wire_map: WireMap,
    seconds: float = 120.0,
    kind: DriveKind = DriveKind.MIXED,
    offsets: Offsets = UNCALIBRATED,
    errors: WheelErrors | TwistErrors | None = None,
    start: Pose2 | None = None,
    rate_hz: float = 1.0,
) -> MeasuredDrive:
    """Draw a robot within the offsets, a drive of it, and what its wheels and its camera measure."""
    robot = true_robot(NOMINAL, offsets.drawn(rng))
    floor = FreeFloor.of(wire_map.floor, 0.25)
    drive = simulate_drive(rng, seconds, kind, floor, start=start)
    odometry = simulate_odometry(drive, robot, NOMINAL, errors or WheelErrors(), rng)
    late_s = robot.time_offset_ns * 1e-9
    clock_s = np.arange(1.0, seconds - 1.0, 1.0 / rate_hz)
    clock_s = clock_s + rng.uniform(0.0, 0.3 / rate_hz, len(clock_s))
    poses = drive.at(np.round(clock_s * 1e9).astype(np.int64))
    camera = robot.camera
    assert camera is not None
    views = []
    for stamp_s, pose in zip(clock_s, poses, strict=True):
        seen = measured_lines_from(camera, wire_map, pose, rng)
        guess = pose + rng.normal(size=3) * [0.03, 0.03, 0.01]
        if len(seen) >= 6:
            views.append(View(float(stamp_s - late_s), guess, seen))
    wheels = robot.wheels
    assert wheels is not None
    driven = [wheels.left_radius_m, wheels.right_radius_m, wheels.baseline_m]
    known = [0.05, 0.05, 0.34]
    std = STD
    if isinstance(errors, TwistErrors):
        driven = [1.0 / (1.0 + errors.forward_scale), 1.0 / (1.0 + errors.turn_scale), -errors.bias_radps]
        known, std = [1.0, 1.0, 0.0], np.append(STD[:6], [0.1, 0.1, 2e-3, 0.05])
    truth = np.concatenate([mount_values(camera.mount), driven, [late_s]])
    prior = Prior(np.concatenate([mount_values(CAMERA.mount), known, [0.0]]), std)
    problem = Problem(
        camera=CAMERA,
        segments=MapLines.of(wire_map),
        map_sigma_m=wire_map.sigma_m,
        record=record_of(odometry),
        odometry=OdometryNoise(),
        prior=prior,
        views=tuple(views),
        noise=NoiseModel(),
    )
    return MeasuredDrive(problem, truth)


def record_of(odometry: Odometry) -> OdometryRecord:
    """Return a simulated session's odometry as the calibration takes it."""
    return OdometryRecord(odometry.stamps_ns * 1e-9, odometry.values, odometry.wheels is not None)


def measured_lines_from(
    camera: Camera, wire_map: WireMap, pose: Array, rng: np.random.Generator, outliers: float = 0.03
) -> SeenLines:
    """Return most of the lines that show from a pose, with noisy ends, some of them a neighbour's."""
    predicted = Projector(camera, wire_map).predict(Pose2.from_array(pose), np.arange(len(wire_map)))
    chosen = (rng.random(len(predicted)) < 0.7) & (predicted.lengths_px > 20.0)
    ends, rows = predicted.ideal_px[chosen], predicted.rows[chosen]
    way = ends[:, 1] - ends[:, 0]
    across = np.column_stack([-way[:, 1], way[:, 0]]) / np.hypot(*way.T)[:, None]
    off = rng.normal(size=(len(ends), 2)) * END_PX
    off += (rng.random(len(ends)) < outliers)[:, None] * rng.uniform(-8.0, 8.0, len(ends))[:, None]
    ends = ends + off[:, :, None] * across[:, None]
    rays = np.concatenate([ends, np.full((len(ends), 2, 1), camera.focal_px)], axis=2)
    sigma = np.full(len(ends), END_PX / np.sqrt(2.0))
    return SeenLines(np.zeros(len(rows), np.int64), rows, rays, sigma, sigma)
