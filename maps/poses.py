"""Planar poses and angles: x, y in metres, phi counter-clockwise in radians, in (-pi, pi]."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@overload
def wrap_angle(angle: float) -> float: ...
@overload
def wrap_angle(angle: Array) -> Array: ...
def wrap_angle(angle: float | Array) -> float | Array:
    """Return the angle, or each of an array of angles, in (-pi, pi]."""
    wrapped = -((-np.asarray(angle) + np.pi) % (2.0 * np.pi) - np.pi)
    return float(wrapped) if wrapped.ndim == 0 else wrapped


@dataclass(frozen=True, slots=True)
class Pose2:
    """A planar rigid transform; as a robot's pose it means `map_from_robot`."""

    x: float
    y: float
    phi: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "phi", wrap_angle(self.phi))

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: `a_from_c = a_from_b @ b_from_c`."""
        cos, sin = math.cos(self.phi), math.sin(self.phi)
        return Pose2(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            self.phi + other.phi,
        )

    def inverse(self) -> Pose2:
        """Return `b_from_a` of this `a_from_b`."""
        cos, sin = math.cos(self.phi), math.sin(self.phi)
        return Pose2(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.phi)

    def minus(self, other: Pose2) -> Array:
        """Return (x, y, phi) of self less other's, component by component, phi wrapped: shape (3,)."""
        return np.array([self.x - other.x, self.y - other.y, wrap_angle(self.phi - other.phi)])

    def as_array(self) -> Array:
        """Return (x, y, phi), shape (3,)."""
        return np.array([self.x, self.y, self.phi])

    @classmethod
    def from_array(cls, values: Array) -> Pose2:
        """Build from (x, y, phi), shape (3,)."""
        return cls(float(values[0]), float(values[1]), float(values[2]))


def frozen(values: Array) -> Array:
    """Return a read-only float64 copy, for the fields of frozen values."""
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy
