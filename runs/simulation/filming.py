"""The frames of a drive: when they are taken, and what the camera sees while it moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from maps.poses import Array, Pose2
from runs.robot import Robot
from runs.simulation.mishaps import Mishaps
from runs.simulation.paths import Drive
from runs.simulation.photograph import GreyImage, Photographer, Sensor
from runs.simulation.scene import Scene
from runs.tables import Times
from vision.camera import Camera

#: A robot's mast shakes: pitch and roll of each frame, standard deviation; a light robot on a rough floor.
SHAKE_RAD = math.radians(0.06)
#: Fast turns get more rays, one for each pixel that the picture smears, up to so many.
_MOST_RAYS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Filming:
    """What takes the pictures: the scene, the true robot, its sensor, its mast's shaking, and what goes wrong."""

    scene: Scene
    robot: Robot
    sensor: Sensor
    shake_rad: float = SHAKE_RAD
    mishaps: Mishaps = field(default_factory=Mishaps)

    def frames(self, drive: Drive, stamps_ns: Times, rng: np.random.Generator) -> Iterator[GreyImage]:
        """Yield the picture at each stamp of the drive's clock; ValueError where the robot has no camera."""
        if self.robot.camera is None:
            raise ValueError("no camera, no pictures")
        photographer = Photographer(self.scene, self.robot.camera, self.sensor)
        for number, stamp_ns in enumerate(stamps_ns.tolist()):
            camera = self.mishaps.camera_at(self.robot.camera, stamp_ns)
            rotations, centres = self._moments(drive, camera, stamp_ns, rng)
            exposure = self.mishaps.exposure_at(stamp_ns, number, camera.height)
            yield photographer.take(rotations, centres, rng, exposure)

    def _moments(
        self, drive: Drive, camera: Camera, stamp_ns: int, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return map_from_optical through the exposure around a stamp: (S, 3, 3) and (S, 3)."""
        exposure_ns = self.sensor.exposure_s * 1e9
        ends = drive.at(np.array([stamp_ns - 0.5 * exposure_ns, stamp_ns + 0.5 * exposure_ns], np.int64))
        smear_px = abs(math.remainder(ends[1, 2] - ends[0, 2], math.tau)) * camera.focal_px
        rays = (
            min(max(self.sensor.rays, math.ceil(smear_px)), _MOST_RAYS) if exposure_ns else self.sensor.rays
        )
        shares = (np.arange(rays) + 0.5) / rays - 0.5
        poses = drive.at(np.round(stamp_ns + shares * exposure_ns).astype(np.int64))
        pitch, roll = self.shake_rad * rng.standard_normal(2)
        mount = camera.mount
        shaken = replace(
            mount, pitch_down_rad=mount.pitch_down_rad + float(pitch), roll_rad=mount.roll_rad + float(roll)
        )
        views = [replace(camera, mount=shaken).map_from_optical(Pose2.from_array(pose)) for pose in poses]
        return np.array([rotation for rotation, _ in views]), np.array([centre for _, centre in views])


def frame_stamps(drive: Drive, rate_hz: float, rng: np.random.Generator) -> Times:
    """Return when frames are taken: at a rate, from a moment in the first period that nobody chose."""
    first, last = drive.stamps_ns[[0, -1]].tolist()
    period_ns = 1e9 / rate_hz
    begin_ns = first + rng.uniform(0.05, 0.95) * period_ns
    return np.round(np.arange(begin_ns, last, period_ns)).astype(np.int64)
