"""The motion model of a differential drive: steps from wheel angles or twists, and their noise.

Between two odometry stamps the robot runs along a circular arc (Thrun et al., Probabilistic Robotics,
section 5.4), so a step is an arc length and a turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.poses import Array, Pose2, frozen


@dataclass(frozen=True, slots=True, eq=False)
class OdometryStep:
    """The robot's motion between two odometry stamps.

    `forward_m` along the arc and `turn_rad` counter-clockwise; `covariance`: (2, 2) of the two
    [m^2, m rad, rad^2]; `sideways_m2`: variance of a slip to the side, of mean zero.
    """

    start_ns: int
    stamp_ns: int
    forward_m: float
    turn_rad: float
    covariance: Array
    sideways_m2: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))

    def part(self, start_ns: int, stamp_ns: int) -> OdometryStep:
        """Return the share of this step between two stamps, motion and variance linear in time.

        Consecutive shares compose back to the step. Stamps beyond its end continue its rates.
        """
        if (start_ns, stamp_ns) == (self.start_ns, self.stamp_ns):
            return self
        share = (stamp_ns - start_ns) / (self.stamp_ns - self.start_ns)
        return OdometryStep(
            start_ns,
            stamp_ns,
            share * self.forward_m,
            share * self.turn_rad,
            share * self.covariance,
            share * self.sideways_m2,
        )

    def continued(self, stamp_ns: int) -> OdometryStep:
        """Guess the motion from this step's end to a later stamp: its rates go on.

        The robot may as well have stopped, or doubled its speed: one standard deviation.
        """
        guess = self.part(self.stamp_ns, stamp_ns)
        unknown = np.diag([guess.forward_m**2, guess.turn_rad**2])
        return OdometryStep(
            guess.start_ns,
            stamp_ns,
            guess.forward_m,
            guess.turn_rad,
            guess.covariance + unknown,
            guess.sideways_m2,
        )

    def then(self, step: OdometryStep) -> tuple[OdometryStep, ...]:
        """Return what lies after this step's end of another one, with the hole between them filled."""
        if step.stamp_ns <= self.stamp_ns:
            return ()
        if step.start_ns <= self.stamp_ns:
            return (step.part(self.stamp_ns, step.stamp_ns),)
        return (self.continued(step.start_ns), step)


@dataclass(frozen=True, slots=True)
class WheelGeometry:
    """The two driven wheels: rolling radii, and the distance between their points of contact [m]."""

    left_radius_m: float
    right_radius_m: float
    baseline_m: float


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """How fast odometry goes wrong; variances grow with the way (Thrun et al., section 5.4).

    The errors of real robots are mostly systematic. White noise stands for them over about a metre,
    the way between two fixes.

    `wheel_m2_per_m`: of each wheel's roll. Radii and baseline off by up to 1 % (0.6 % rms) and a
    little slip: 7 mm after a metre.
    `twist_forward_m2_per_m`, `twist_turn_rad2_per_rad`, `twist_turn_rad2_per_m`: twists are often
    commanded or filtered speeds; a metre forward is off by 10 cm, a turn of 1 rad by 0.1 rad, and a
    straight metre bends by 0.1 rad, as when the wheels' speeds differ by 3 % on a baseline of 0.3 m.
    `sideways_share`: of the forward variance; slip in turns, a base frame not quite on the axle.
    `floor_m2_per_s`, `floor_rad2_per_s`: 1 mm and 0.1 degrees after a second, moving or not. At
    standstill one view, and so one error, comes again and again: averaging must not trust it.
    """

    wheel_m2_per_m: float = 5e-5
    twist_forward_m2_per_m: float = 1e-2
    twist_turn_rad2_per_rad: float = 1e-2
    twist_turn_rad2_per_m: float = 1e-2
    sideways_share: float = 0.1
    floor_m2_per_s: float = 1e-6
    floor_rad2_per_s: float = 4e-6


def wheel_step(
    start_ns: int,
    stamp_ns: int,
    left_rad: float,
    right_rad: float,
    geometry: WheelGeometry,
    noise: OdometryNoise,
) -> OdometryStep:
    """Return the step of wheels that turned by `left_rad` and `right_rad` between two stamps."""
    left_m, right_m = geometry.left_radius_m * left_rad, geometry.right_radius_m * right_rad
    step_from_wheels = np.array([[0.5, 0.5], [-1.0 / geometry.baseline_m, 1.0 / geometry.baseline_m]])
    rolled = noise.wheel_m2_per_m * np.abs([left_m, right_m])
    forward_m, turn_rad = step_from_wheels @ [left_m, right_m]
    covariance = (step_from_wheels * rolled) @ step_from_wheels.T
    return _floored(start_ns, stamp_ns, float(forward_m), float(turn_rad), covariance, noise)


def twist_step(
    start_ns: int, stamp_ns: int, forward_mps: float, turn_radps: float, noise: OdometryNoise
) -> OdometryStep:
    """Return the step of a robot that kept one twist between two stamps."""
    seconds = (stamp_ns - start_ns) * 1e-9
    forward_m, turn_rad = forward_mps * seconds, turn_radps * seconds
    covariance = np.diag(
        [
            noise.twist_forward_m2_per_m * abs(forward_m),
            noise.twist_turn_rad2_per_rad * abs(turn_rad) + noise.twist_turn_rad2_per_m * abs(forward_m),
        ]
    )
    return _floored(start_ns, stamp_ns, forward_m, turn_rad, covariance, noise)


def _floored(
    start_ns: int, stamp_ns: int, forward_m: float, turn_rad: float, covariance: Array, noise: OdometryNoise
) -> OdometryStep:
    seconds = (stamp_ns - start_ns) * 1e-9
    floor_m2, floor_rad2 = noise.floor_m2_per_s * seconds, noise.floor_rad2_per_s * seconds
    sideways_m2 = noise.sideways_share * float(covariance[0, 0]) + floor_m2
    floored = covariance + np.diag([floor_m2, floor_rad2])
    return OdometryStep(start_ns, stamp_ns, forward_m, turn_rad, floored, sideways_m2)


def advance(pose: Pose2, step: OdometryStep) -> Pose2:
    """Move a pose along a step's arc: a chord of f sin(h)/h at heading phi + h, with h half the turn."""
    half = 0.5 * step.turn_rad
    chord, middle = step.forward_m * _sinc(half), pose.phi + half
    return Pose2(
        pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), pose.phi + step.turn_rad
    )


def motion_jacobians(pose: Pose2, step: OdometryStep) -> tuple[Array, Array]:
    """Return the derivatives of `advance`: F (3, 3) by the pose, G (3, 2) by (forward, turn)."""
    half = 0.5 * step.turn_rad
    cos, sin = math.cos(pose.phi + half), math.sin(pose.phi + half)
    ratio, slope = _sinc(half), 0.5 * step.forward_m * _sinc_slope(half)
    chord = step.forward_m * ratio
    by_pose = np.array([[1.0, 0.0, -chord * sin], [0.0, 1.0, chord * cos], [0.0, 0.0, 1.0]])
    by_motion = np.array(
        [
            [ratio * cos, slope * cos - 0.5 * chord * sin],
            [ratio * sin, slope * sin + 0.5 * chord * cos],
            [0.0, 1.0],
        ]
    )
    return by_pose, by_motion


def motion_noise(pose: Pose2, step: OdometryStep, by_motion: Array) -> Array:
    """Return the covariance (3, 3), map frame, that a step adds: of its motion and its sideways slip.

    `by_motion`: (3, 2), the G of `motion_jacobians`.
    """
    middle = pose.phi + 0.5 * step.turn_rad
    left = np.array([[-math.sin(middle)], [math.cos(middle)], [0.0]])
    noise: Array = by_motion @ step.covariance @ by_motion.T + step.sideways_m2 * (left @ left.T)
    return noise


def _sinc(angle: float) -> float:
    return 1.0 - angle**2 / 6.0 if abs(angle) < 1e-4 else math.sin(angle) / angle


def _sinc_slope(angle: float) -> float:
    if abs(angle) < 1e-2:
        return -angle / 3.0 + angle**3 / 30.0 - angle**5 / 840.0
    return (angle * math.cos(angle) - math.sin(angle)) / angle**2
