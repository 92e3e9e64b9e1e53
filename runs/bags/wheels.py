"""Odometry in bags: messages of motion as rows, wheel angles or twists."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import atan2
from pathlib import Path
from typing import Any

import numpy as np

from maps.errors import InputError
from maps.poses import Array, wrap_angle
from runs.bags.opening import stamp_ns
from runs.tables import Times

#: Faster than any robot indoors: there the pose was set anew, not driven.
JUMP_MPS, JUMP_RADPS = 10.0, 20.0
#: Poses and twists that differ by less [m/s, rad/s] say the same: what is between them is round-off.
SAME_TWIST = 1e-8

_SIDES = [re.compile(side, re.IGNORECASE) for side in (r"left|(^|_)l(_|$)", r"right|(^|_)r(_|$)")]
_WHEEL = re.compile("wheel", re.IGNORECASE)


@dataclass(slots=True)
class WheelRows:
    """Collects the wheels' angles out of JointState messages, from the two joints or those that are guessed."""

    path: Path
    topic: str
    joints: tuple[str, str] | None = None
    values: list[tuple[float, float]] = field(default_factory=list)

    def take(self, message: Any) -> bool:
        """Add a row; False where the message tells of other joints."""
        names = list(message.name)
        if self.joints is None:
            self.joints = self._guess(names)
        if self.joints is None or not set(self.joints) <= set(names):
            return False
        left, right = (names.index(joint) for joint in self.joints)
        if max(left, right) >= len(message.position):
            raise InputError(self.path, self.topic, "joints have no positions, which are the wheels' angles")
        self.values.append((float(message.position[left]), float(message.position[right])))
        return True

    def rows(self) -> Array:
        """Return cumulative angles, (N, 2) [rad]; those that are kept within a turn are unrolled."""
        values = np.reshape(np.array(self.values), (-1, 2))
        return np.unwrap(values, axis=0) if (np.abs(values) <= np.pi + 1e-6).all() else values

    def _guess(self, names: list[str]) -> tuple[str, str] | None:
        found = [[name for name in names if _WHEEL.search(name) and side.search(name)] for side in _SIDES]
        if any(len(fitting) > 1 for fitting in found):
            raise InputError(
                self.path, self.topic, f"which wheels? name them with --joints: {', '.join(names)}"
            )
        return (found[0][0], found[1][0]) if all(found) else None


@dataclass(slots=True)
class TwistRows:
    """Collects poses and twists out of Odometry messages; `frame` is the robot's, as the messages call it."""

    stamps_ns: list[int] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)
    twists: list[tuple[float, float]] = field(default_factory=list)
    frame: str = ""

    def take(self, message: Any) -> bool:
        """Add a row."""
        pose, twist = message.pose.pose, message.twist.twist
        self.frame = self.frame or message.child_frame_id
        self.stamps_ns.append(stamp_ns(message))
        self.poses.append((pose.position.x, pose.position.y, heading(pose.orientation)))
        self.twists.append((twist.linear.x, twist.angular.z))
        return True


def heading(orientation: Any) -> float:
    """Return the turn about the vertical of a quaternion message [rad]."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def held_twists(stamps_ns: Times, poses: Array, twists: Array) -> tuple[Array, int]:
    """Return the twist that each row holds until the next, (N, 2) [m/s, rad/s], and how often a pose jumped.

    `stamps_ns` (N,) rising; `poses` (N, 3) in a frame of odometry's own; `twists` (N, 2) as the messages tell
    them. The poses decide: they add up all that the wheels did, where twists are samples. The twists count where
    poses never change, where one jumps, and where both say the same.
    """
    moves = np.diff(poses, axis=0)
    if not moves.any():
        return twists, 0
    seconds = np.diff(stamps_ns) * 1e-9
    turn = wrap_angle(moves[:, 2])
    middle = poses[:-1, 2] + 0.5 * turn
    along = moves[:, 0] * np.cos(middle) + moves[:, 1] * np.sin(middle)
    # The chord of an arc is shorter by sin(a) / a, a half the turn.
    driven = np.column_stack([along / np.sinc(0.5 * turn / np.pi), turn]) / seconds[:, None]
    away_m = np.hypot(moves[:, 0], moves[:, 1])
    jumps = (away_m > JUMP_MPS * seconds) | (np.abs(turn) > JUMP_RADPS * seconds)
    same = np.isclose(driven, twists[:-1], rtol=0.0, atol=SAME_TWIST)
    driven = np.where(same | jumps[:, None], twists[:-1], driven)
    return np.vstack([driven, twists[-1:]]), int(jumps.sum())
