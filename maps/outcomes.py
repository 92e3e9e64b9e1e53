"""What vision and localization say to each other: beliefs, search windows, outcomes of a look.

A fix is a stamped Gaussian, so localization needs no vision; a search is a window, so vision
needs no filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2, frozen, wrap_angle

#: A fix that constrains every direction this well is whole; a weaker one is partial.
FIX_POSITION_STD_M = 0.15
FIX_HEADING_STD_RAD = math.radians(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A Gaussian belief of map_from_robot at one time.

    `covariance`: (3, 3) over (x, y, phi) in the map frame [m^2, m rad, rad^2]. An infinite
    variance (with zero correlations) means that this component was not measured.
    """

    stamp_ns: int
    pose: Pose2
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Which of (x, y, phi) have a finite variance, shape (3,)."""
        return np.isfinite(np.diag(self.covariance))

    @property
    def position_std_m(self) -> float:
        """The standard deviation of the position along its worst direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def heading_std_rad(self) -> float:
        """The standard deviation of the heading; infinite where it was not measured."""
        return math.sqrt(float(self.covariance[2, 2]))


@dataclass(frozen=True, slots=True, eq=False)
class PoseEllipsoid:
    """Poses whose squared Mahalanobis distance from a centre is at most `gate`; x, y and phi together.

    `covariance`: (3, 3) positive definite, over (x, y, phi) in the map frame [m^2, m rad, rad^2].
    """

    centre: Pose2
    covariance: Array
    gate: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PoseEllipsoid):
            return NotImplemented
        return (self.centre, self.gate, self.covariance.tolist()) == (
            other.centre,
            other.gate,
            other.covariance.tolist(),
        )

    def __hash__(self) -> int:
        return hash((self.centre, self.gate, self.covariance.tobytes()))

    @property
    def matrix(self) -> Array:
        """The matrix A (3, 3) of the bound, d' A d <= 1 for a pose d away from the centre."""
        return np.asarray(np.linalg.inv(self.gate * self.covariance), np.float64)

    @property
    def volume(self) -> float:
        """The ellipsoid's volume [m^2 rad]."""
        return 4.0 / 3.0 * math.pi * math.sqrt(float(np.linalg.det(self.gate * self.covariance)))

    def holds(self, poses: Array) -> NDArray[np.bool_]:
        """Whether poses (H, 3) lie inside, (H,)."""
        away = poses - self.centre.as_array()
        away[:, 2] = wrap_angle(away[:, 2])
        result: NDArray[np.bool_] = np.einsum("hi,ij,hj->h", away, self.matrix, away) <= 1.0 + 1e-9
        return result

    def spread_at(self, belief: PoseBelief) -> float:
        """Return how much a flat prior as dense as the Gaussian is at a belief would hold [m^2 rad].

        Near the centre that is a fraction of the `volume`; it is no more than that at the rim.
        """
        away = belief.pose.minus(self.centre)
        squared = float(away @ np.linalg.solve(self.covariance + belief.covariance, away))
        flat = math.sqrt(float(np.linalg.det(2.0 * math.pi * self.covariance)))
        return min(flat * math.exp(0.5 * min(squared, self.gate)), self.volume)

    def widened(self, by: Array) -> PoseEllipsoid:
        """Return the ellipsoid with its half-axes longer by up to `by` (3,) [m, m, rad], where it is thin."""
        return PoseEllipsoid(self.centre, self.covariance + np.diag(by**2) / self.gate, self.gate)

    def may_hold(self, belief: PoseBelief) -> bool:
        """Whether the true pose may lie inside by a belief: the gate on the difference, with both covariances."""
        away = belief.pose.minus(self.centre)
        return float(away @ np.linalg.solve(self.covariance + belief.covariance, away)) <= self.gate


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """Where to look: within `dt_m` of the centre and within `dphi_rad` of its heading (paper, 3.2).

    Being lost is only a large window: an infinite `dt_m` takes in the whole floor. `ellipsoid`: what the disc and
    the slice of headings are cut down to, where more is known: a long, thin doubt needs no whole disc.
    """

    centre: Pose2
    dt_m: float
    dphi_rad: float
    ellipsoid: PoseEllipsoid | None = None

    @classmethod
    def everywhere(cls) -> SearchWindow:
        """Return the window of a robot that knows nothing."""
        return cls(Pose2(0.0, 0.0, 0.0), math.inf, math.pi)

    def holds(self, pose: Pose2) -> bool:
        """Whether a pose lies inside."""
        return bool(self.held(pose.as_array()[None])[0])

    def held(self, poses: Array) -> NDArray[np.bool_]:
        """Whether poses (H, 3) lie inside, (H,)."""
        away = poses - self.centre.as_array()
        turn = np.abs(wrap_angle(away[:, 2]))
        near: NDArray[np.bool_] = (np.hypot(away[:, 0], away[:, 1]) <= self.dt_m) & (turn <= self.dphi_rad)
        return near if self.ellipsoid is None else near & self.ellipsoid.holds(poses)


class Reason(StrEnum):
    """Why a look at the world gave no fix."""

    UNREADABLE_IMAGE = "UNREADABLE_IMAGE"
    TOO_FEW_SEGMENTS = "TOO_FEW_SEGMENTS"
    NOTHING_VISIBLE = "NOTHING_VISIBLE"
    NO_HYPOTHESIS = "NO_HYPOTHESIS"
    WEAK_EVIDENCE = "WEAK_EVIDENCE"
    WEAK_GEOMETRY = "WEAK_GEOMETRY"


def _no_rows() -> NDArray[np.int64]:
    return np.zeros(0, np.int64)


def _no_lines() -> Array:
    return np.zeros((0, 2, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a matcher saw, counted and paired on its way to an outcome; for logs and pictures.

    `lines_px`: (M, 2, 2) lines extracted from the image, raw pixels.
    `predicted_px`: (P, 2, 2) visible pieces of map segments at the pose found, else at the window's
    centre, raw pixels; `predicted_map`: (P,) their rows of the wire map.
    `matched_map`, `matched_image`: (K,) rows of the wire map and of `lines_px` that are paired;
    `residuals_px`: (K,) root mean square distance of each image line from its predicted one.
    `selected`: map segments tried in the window; `hypotheses`: poses scored; `refined`: those of them that were
    worth a closer look; `score`: log-likelihood ratio of the best one against chance. `polarity`: (M,) +1 where an
    image line is brighter on its right-hand side, -1 darker, 0 unknown; empty (0,) where nobody says.
    """

    lines_px: Array = field(default_factory=_no_lines)
    predicted_px: Array = field(default_factory=_no_lines)
    predicted_map: NDArray[np.int64] = field(default_factory=_no_rows)
    matched_map: NDArray[np.int64] = field(default_factory=_no_rows)
    matched_image: NDArray[np.int64] = field(default_factory=_no_rows)
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    selected: int = 0
    hypotheses: int = 0
    refined: int = 0
    score: float = 0.0
    polarity: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """One pose that the world supports at the image's stamp; partial where geometry is weak."""

    belief: PoseBelief
    look: Look = field(default_factory=Look)

    @property
    def partial(self) -> bool:
        """Whether some direction is constrained less than a whole fix promises."""
        return (
            self.belief.position_std_m >= FIX_POSITION_STD_M
            or self.belief.heading_std_rad >= FIX_HEADING_STD_RAD
        )


@dataclass(frozen=True, slots=True, eq=False)
class Ambiguous:
    """Several poses that the image cannot tell apart, with their odds (summing to one)."""

    beliefs: tuple[PoseBelief, ...]
    odds: tuple[float, ...]
    look: Look = field(default_factory=Look)


@dataclass(frozen=True, slots=True, eq=False)
class NoFix:
    """No pose, and why."""

    reason: Reason
    look: Look = field(default_factory=Look)


Outcome = Fix | Ambiguous | NoFix
