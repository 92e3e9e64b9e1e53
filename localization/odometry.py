"""The motion model of a differential drive: steps from wheel angles or twists, and their noise."""

from __future__ import annotations

from dataclasses import dataclass

from maps.poses import Array, frozen


@dataclass(frozen=True, slots=True, eq=False)
class OdometryStep:
    """The robot's motion between two odometry stamps.

    `forward_m` along the arc and `turn_rad` counter-clockwise; `covariance`: (2, 2) of the two
    [m^2, m rad, rad^2].
    """

    start_ns: int
    stamp_ns: int
    forward_m: float
    turn_rad: float
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))
