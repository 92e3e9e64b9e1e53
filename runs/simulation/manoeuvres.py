"""What a drive is made of: moves along smooth curves, turns on the spot, waits; each from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.poses import Array, Pose2, frozen

#: Knots of a curve lie this near to each other.
_KNOT_M, _KNOT_RAD = 0.005, 0.005
#: A corner's Bezier points on each leg, as shares of the blend, counted from the corner. Three in line
#: make the curvature begin and end at zero.
_LEG = np.array([1.0, 0.6, 0.2])
_CORNER_KNOTS = 161


@dataclass(frozen=True, slots=True)
class Motion:
    """How a robot drives: the largest speed [m/s], turn rate [rad/s] and their rates of change.

    `sideways_mps2` bounds the centripetal acceleration in curves.
    """

    speed_mps: float = 0.6
    turn_radps: float = 0.9
    acceleration_mps2: float = 0.4
    turn_acceleration_radps2: float = 2.0
    sideways_mps2: float = 0.5

    @property
    def curvature_per_m(self) -> float:
        """The sharpest curve in which speeding up stays within half the turn acceleration."""
        return self.turn_acceleration_radps2 / (2.0 * self.acceleration_mps2)


@dataclass(frozen=True, slots=True, eq=False)
class Manoeuvre:
    """Poses along a way, and when the robot is where.

    `way`: (K,) metres or radians along it, never falling. `poses`: (K, 3), headings not wrapped.
    `times_s`, `speeds`: (K,) when each knot is passed and how fast; accelerations are constant between.
    """

    way: Array
    poses: Array
    times_s: Array
    speeds: Array

    def __post_init__(self) -> None:
        for name in ("way", "poses", "times_s", "speeds"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return float(self.times_s[-1])

    @property
    def end(self) -> Pose2:
        """Where it ends."""
        return Pose2.from_array(self.poses[-1])

    def at(self, times_s: Array) -> Array:
        """Return the poses (T, 3) at times from its start (T,); headings are not wrapped."""
        knot = np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self.way) - 2)
        lasting = self.times_s[knot + 1] - self.times_s[knot]
        since = np.clip(times_s - self.times_s[knot], 0.0, lasting)
        rate = (self.speeds[knot + 1] - self.speeds[knot]) / np.maximum(lasting, 1e-12)
        way = self.way[knot] + (self.speeds[knot] + 0.5 * rate * since) * since
        return np.column_stack([np.interp(way, self.way, column) for column in self.poses.T])


def wait(pose: Pose2, seconds: float) -> Manoeuvre:
    """Stand still."""
    return Manoeuvre(np.zeros(2), np.tile(pose.as_array(), (2, 1)), np.array([0.0, seconds]), np.zeros(2))


def turn(pose: Pose2, angle_rad: float, motion: Motion) -> Manoeuvre:
    """Turn on the spot, counter-clockwise where the angle is above zero."""
    way = np.linspace(0.0, abs(angle_rad), max(2, math.ceil(abs(angle_rad) / _KNOT_RAD)) + 1)
    poses = np.tile(pose.as_array(), (len(way), 1))
    poses[:, 2] += math.copysign(1.0, angle_rad) * way
    return _timed(way, poses, np.full(len(way), motion.turn_radps), motion.turn_acceleration_radps2)


def move(points: Array, blends_m: Array, motion: Motion) -> Manoeuvre:
    """Drive along a polyline (P, 2), P >= 2, its inner corners blended from `blends_m` (P - 2,) before to after.

    Blends on one leg must not overlap.
    """
    poses, curvature = _curve(points, blends_m)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    way = np.append(0.0, np.cumsum(steps))
    bend = np.abs(curvature)
    change = np.abs(np.gradient(curvature, way))
    with np.errstate(divide="ignore"):
        limits = np.minimum.reduce(
            [
                np.full(len(way), motion.speed_mps),
                motion.turn_radps / bend,
                np.sqrt(motion.sideways_mps2 / bend),
                np.sqrt(0.5 * motion.turn_acceleration_radps2 / change),
            ]
        )
    return _timed(way, poses, limits, motion.acceleration_mps2)


def sharpest(angle_rad: float) -> float:
    """Return the largest curvature of a corner of that turn, blended over 1 m; it falls as 1 / blend."""
    out = np.array([math.cos(angle_rad), math.sin(angle_rad)])
    _, curvature = _corner(np.zeros(2), np.array([1.0, 0.0]), out, 1.0)
    return float(np.abs(curvature).max())


def _timed(way: Array, poses: Array, limits: Array, acceleration: float) -> Manoeuvre:
    """Go as fast as the limits (K,) and the acceleration allow, from rest to rest."""
    ceiling = limits**2
    ceiling[[0, -1]] = 0.0
    # v^2 can rise, and before the end must fall, by 2 a for each unit of the way.
    rising = 2.0 * acceleration * way
    forward = rising + np.minimum.accumulate(ceiling - rising)
    backward = np.minimum.accumulate((ceiling + rising)[::-1])[::-1] - rising
    speeds = np.sqrt(np.maximum(np.minimum(forward, backward), 0.0))
    means = 0.5 * (speeds[1:] + speeds[:-1])
    times = np.append(0.0, np.cumsum(np.diff(way) / means))
    return Manoeuvre(way, poses, times, speeds)


def _curve(points: Array, blends_m: Array) -> tuple[Array, Array]:
    """Return poses (K, 3) and curvatures (K,) along a polyline with blended corners."""
    legs = np.diff(points, axis=0)
    lengths = np.hypot(*legs.T)
    units = legs / lengths[:, None]
    blends = np.concatenate([[0.0], blends_m, [0.0]])
    places: list[Array] = []
    bends: list[Array] = []
    for leg, (start, unit) in enumerate(zip(points, units, strict=False)):
        low, high = blends[leg], lengths[leg] - blends[leg + 1]
        straight = np.linspace(low, high, max(2, math.ceil((high - low) / _KNOT_M)) + 1)
        places.append(start + straight[:, None] * unit)
        bends.append(np.zeros(len(straight)))
        if leg + 1 < len(units):
            corner, curvature = _corner(points[leg + 1], unit, units[leg + 1], blends[leg + 1])
            places.append(corner)
            bends.append(curvature)
    xy, curvature = np.concatenate(places), np.concatenate(bends)
    fresh = np.append(True, np.hypot(*np.diff(xy, axis=0).T) > 1e-7)
    xy, curvature = xy[fresh], curvature[fresh]
    steps = np.hypot(*np.diff(xy, axis=0).T)
    # The tangent is the integral of the curvature, so that headings and positions agree.
    turned = np.append(0.0, np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * steps))
    heading = math.atan2(units[0, 1], units[0, 0]) + turned
    return np.column_stack([xy, heading]), curvature


def _corner(corner: Array, along: Array, out: Array, blend_m: float) -> tuple[Array, Array]:
    """Return points (K, 2) and curvatures (K,) of a quintic Bezier curve inside a corner's triangle."""
    control = np.concatenate(
        [corner - blend_m * np.outer(_LEG, along), corner + blend_m * np.outer(_LEG, out)[::-1]]
    )
    share = np.linspace(0.0, 1.0, _CORNER_KNOTS)
    first, second = 5.0 * np.diff(control, axis=0), 20.0 * np.diff(control, n=2, axis=0)
    place, speed, force = _bezier(control, share), _bezier(first, share), _bezier(second, share)
    cross = speed[:, 0] * force[:, 1] - speed[:, 1] * force[:, 0]
    return place, cross / np.maximum(np.hypot(*speed.T), 1e-12) ** 3


def _bezier(control: Array, share: Array) -> Array:
    """Return a Bezier curve's points (K, 2) at shares (K,) of its control points (D + 1, 2)."""
    degree = len(control) - 1
    terms = [math.comb(degree, k) * share**k * (1.0 - share) ** (degree - k) for k in range(degree + 1)]
    result: Array = np.column_stack(terms) @ control
    return result
