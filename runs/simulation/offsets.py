"""What a robot truly is, beside what robot.yaml says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from localization.odometry import WheelGeometry
from runs.robot import Robot


@dataclass(frozen=True, slots=True)
class Offsets:
    """Truth less nominal value: shares of the wheels' measures, metres, radians and seconds of the camera's."""

    left_radius: float = 0.0
    right_radius: float = 0.0
    baseline: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    height_m: float = 0.0
    pitch_down_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    time_offset_s: float = 0.0

    def drawn(self, rng: np.random.Generator) -> Offsets:
        """Draw offsets, each even between less and plus this one's."""
        return Offsets(*(float(rng.uniform(-1.0, 1.0)) * getattr(self, one.name) for one in fields(self)))


#: How far a robot that was measured with a tape may be from its file.
UNCALIBRATED = Offsets(
    *(0.01, 0.01, 0.01, 0.02, 0.02, 0.02), *(math.radians(1.0), math.radians(1.0), math.radians(1.0)), 0.05
)
#: What remains after a calibration.
CALIBRATED = Offsets(0.003, 0.003, 0.003, 0.003, 0.003, 0.003, 0.002, 0.002, 0.002, 0.0)


def true_robot(nominal: Robot, offsets: Offsets) -> Robot:
    """Return the robot as it truly is."""
    wheels, camera = nominal.wheels, nominal.camera
    if wheels is not None:
        wheels = WheelGeometry(
            wheels.left_radius_m * (1.0 + offsets.left_radius),
            wheels.right_radius_m * (1.0 + offsets.right_radius),
            wheels.baseline_m * (1.0 + offsets.baseline),
        )
    if camera is not None:
        names = ("x_m", "y_m", "height_m", "pitch_down_rad", "yaw_rad", "roll_rad")
        moved = {name: getattr(camera.mount, name) + getattr(offsets, name) for name in names}
        camera = replace(camera, mount=replace(camera.mount, **moved))
    late_ns = nominal.time_offset_ns + round(offsets.time_offset_s * 1e9)
    return replace(nominal, wheels=wheels, camera=camera, time_offset_ns=late_ns)
