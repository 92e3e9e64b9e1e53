"""Drives: where a robot is at every fiftieth of a second, along smooth ways with turns and stops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from maps.poses import Array, Pose2, frozen, wrap_angle
from runs.runlog import Trajectory
from runs.simulation.freefloor import FreeFloor, open_floor
from runs.simulation.manoeuvres import Manoeuvre, Motion, move, sharpest, turn, wait
from runs.tables import Times

TRUTH_HZ = 50.0

#: Blends of corners [m]: the longest, and how many shorter ones are tried where it does not fit.
_BLEND_M, _BLENDS = 1.2, 5
#: Corners sharper than this are turned on the spot.
_SHARP_RAD = math.radians(130.0)
#: At a goal: the odds of a stop, how long it lasts [s], the odds of a look around; goals at least so far off [m].
_STOP_ODDS, _STOP_S, _LOOK_ODDS, _FAR_M = 0.5, (0.5, 3.0), 0.4, 2.0
#: Straight drives stop after so many metres.
_STRAIGHT_M = (2.0, 8.0)


class DriveKind(StrEnum):
    """What a robot does all the time; only MIXED needs a floor."""

    MIXED = "mixed"
    STRAIGHT = "straight"
    TURNING = "turning"
    STANDING = "standing"


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The truth: `stamps_ns` (N,) at TRUTH_HZ, `poses` (N, 3) of map_from_robot, headings in (-pi, pi]."""

    stamps_ns: Times
    poses: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses", frozen(self.poses))

    def at(self, stamps_ns: Times) -> Array:
        """Return the poses (K, 3) at stamps (K,), linear between the drive's own; held before and after."""
        turned = np.unwrap(self.poses[:, 2])
        columns = [self.poses[:, 0], self.poses[:, 1], turned]
        poses = np.column_stack([np.interp(stamps_ns, self.stamps_ns, column) for column in columns])
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses

    def steps(self) -> tuple[Array, Array]:
        """Return the way along the arc [m] and the turn [rad] between consecutive poses, (N - 1,) each."""
        turned = wrap_angle(np.diff(self.poses[:, 2]))
        middle = self.poses[:-1, 2] + 0.5 * turned
        dx, dy = np.diff(self.poses[:, :2], axis=0).T
        chord = dx * np.cos(middle) + dy * np.sin(middle)
        return chord / np.sinc(turned / (2.0 * np.pi)), turned

    @property
    def length_m(self) -> float:
        """How far the robot drove."""
        return float(np.abs(self.steps()[0]).sum())

    def truth(self) -> Trajectory:
        """Return it as a trajectory, for the evaluation."""
        return Trajectory(self.stamps_ns, self.poses)


def simulate_drive(
    rng: np.random.Generator,
    seconds: float,
    kind: DriveKind = DriveKind.MIXED,
    floor: FreeFloor | None = None,
    motion: Motion | None = None,
    start: Pose2 | None = None,
) -> Drive:
    """Draw a drive of that length from rest; it may end on the way.

    A mixed drive stays on the floor, an open square of 10 m without one. `start`: drawn where nobody says;
    the origin without a floor.
    """
    motion = motion or Motion()
    if start is None:
        heading = float(rng.uniform(-np.pi, np.pi))
        x, y = floor.place(rng).tolist() if floor else (0.0, 0.0)
        start = Pose2(x, y, heading)
    if kind is DriveKind.MIXED:
        return _sampled(_wander(rng, seconds, floor or open_floor(), motion, start), seconds)
    return _sampled(_drill(rng, seconds, kind, motion, start), seconds)


def _drill(
    rng: np.random.Generator, seconds: float, kind: DriveKind, motion: Motion, start: Pose2
) -> list[Manoeuvre]:
    """Stand, turn to and fro, or drive straight on with stops, until the time is over."""
    parts = [wait(start, seconds if kind is DriveKind.STANDING else 0.5)]
    side = rng.choice([-1.0, 1.0])
    while sum(part.duration_s for part in parts) < seconds:
        here = parts[-1].end
        if kind is DriveKind.TURNING:
            parts.append(turn(here, float(side * rng.uniform(0.5 * np.pi, 2.0 * np.pi)), motion))
            side = -side
        else:
            ahead = here @ Pose2(float(rng.uniform(*_STRAIGHT_M)), 0.0, 0.0)
            parts.append(move(np.array([[here.x, here.y], [ahead.x, ahead.y]]), np.zeros(0), motion))
        parts.append(wait(parts[-1].end, float(rng.uniform(*_STOP_S))))
    return parts


def _wander(
    rng: np.random.Generator, seconds: float, floor: FreeFloor, motion: Motion, start: Pose2
) -> list[Manoeuvre]:
    """Drive from goal to goal, with stops and looks around, until the time is over."""
    parts = [wait(start, float(rng.uniform(*_STOP_S)))]
    been = [np.array([start.x, start.y])]
    spent_s = parts[0].duration_s
    while spent_s < seconds:
        route = floor.route(been[-1], _goal(rng, floor, been))
        fresh = _along(rng, route, parts[-1].end, floor, motion)
        if rng.random() < _STOP_ODDS:
            fresh.append(wait(fresh[-1].end, float(rng.uniform(*_STOP_S))))
        if rng.random() < _LOOK_ODDS:
            fresh.append(turn(fresh[-1].end, float(rng.uniform(-np.pi, np.pi)), motion))
        been.append(route[-1])
        parts += fresh
        spent_s += sum(part.duration_s for part in fresh)
    return parts


def _goal(rng: np.random.Generator, floor: FreeFloor, been: list[Array]) -> Array:
    """Return, of a few places, the one farthest from where the robot has been of late."""
    places = np.array([floor.place(rng) for _ in range(4)])
    recent = np.array(been[-6:])
    away = np.hypot(*(places[:, None] - recent).transpose(2, 0, 1)).min(axis=1)
    away[np.hypot(*(places - been[-1]).T) < _FAR_M] *= 0.1
    best: Array = places[away.argmax()]
    return best


def _along(
    rng: np.random.Generator, route: Array, start: Pose2, floor: FreeFloor, motion: Motion
) -> list[Manoeuvre]:
    """Drive a route (P, 2): corners blended where that is free, turned on the spot elsewhere."""
    legs = np.diff(route, axis=0)
    route = route[np.append(True, np.hypot(*legs.T) > 1e-6)]
    parts: list[Manoeuvre] = []
    here, points, blends = start, [route[0]], list[float]()
    for row in range(1, len(route)):
        points.append(route[row])
        last = row == len(route) - 1
        # The leg behind gives what the last blend left of it, the one ahead at most half.
        room_m = float(np.hypot(*(route[row] - route[row - 1]))) - (blends[-1] if blends else 0.0)
        blend_m = None if last else _blend(rng, route[row - 1 : row + 2], room_m, floor, motion)
        if blend_m is not None:
            blends.append(blend_m)
            continue
        ahead = math.atan2(*(points[1] - points[0])[::-1])
        if abs(angle := wrap_angle(ahead - here.phi)) > 1e-6:
            parts.append(turn(here, angle, motion))
        parts.append(move(np.array(points), np.array(blends), motion))
        here, points, blends = parts[-1].end, [route[row]], []
    return parts


def _blend(
    rng: np.random.Generator, corner: Array, room_m: float, floor: FreeFloor, motion: Motion
) -> float | None:
    """Return how long before and after a corner (3, 2) its blend can be; None to turn on the spot."""
    before, after = np.diff(corner, axis=0)
    angle = wrap_angle(math.atan2(after[1], after[0]) - math.atan2(before[1], before[0]))
    longest = min(_BLEND_M, 0.9 * room_m, 0.5 * float(np.hypot(*after)))
    shortest = max(sharpest(angle) / motion.curvature_per_m, 0.02)
    if abs(angle) > _SHARP_RAD or shortest > longest:
        return None
    units = np.array([before / np.hypot(*before), after / np.hypot(*after)])
    for blend_m in np.linspace(rng.uniform(shortest, longest), shortest, _BLENDS):
        if floor.covers(corner[1] + blend_m * np.array([-units[0], [0.0, 0.0], units[1]])):
            return float(blend_m)
    return None


def _sampled(parts: list[Manoeuvre], seconds: float) -> Drive:
    """Join manoeuvres end to end and sample them."""
    count = round(seconds * TRUTH_HZ) + 1
    times = np.arange(count) / TRUTH_HZ
    starts = np.append(0.0, np.cumsum([part.duration_s for part in parts]))
    poses = np.empty((count, 3))
    which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(parts) - 1)
    for number, part in enumerate(parts):
        rows = which == number
        poses[rows] = part.at(times[rows] - starts[number])
    poses[:, 2] = wrap_angle(poses[:, 2])
    stamps_ns = np.round(times * 1e9).astype(np.int64)
    stamps_ns.setflags(write=False)
    return Drive(stamps_ns, poses)
