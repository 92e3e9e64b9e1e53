"""The pose in the odometry frame (REP-105): continuous, drifting, wherever the map may be."""

from __future__ import annotations

from localization.odometry import OdometryStep, advance
from maps.poses import Pose2


class DeadReckoning:
    """Adds up odometry from the first step on, where the frame's origin is."""

    def __init__(self) -> None:
        """Begin before the first step."""
        self.odom_from_robot = Pose2(0.0, 0.0, 0.0)
        self._last: OdometryStep | None = None

    @property
    def stamp_ns(self) -> int:
        """The end of the newest step, 0 before the first."""
        return self._last.stamp_ns if self._last else 0

    def follow(self, step: OdometryStep) -> None:
        """Add a step; what it repeats is left out, what is missing before it is guessed."""
        for piece in self._last.then(step) if self._last else (step,):
            self.odom_from_robot = advance(self.odom_from_robot, piece)
            self._last = piece
