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

from maps.poses import Array, Pose2, frozen

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


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """Where to look: within `dt_m` of the centre and within `dphi_rad` of its heading (paper, 3.2).

    Being lost is only a large window: an infinite `dt_m` takes in the whole floor.
    """

    centre: Pose2
    dt_m: float
    dphi_rad: float

    @classmethod
    def everywhere(cls) -> SearchWindow:
        """Return the window of a robot that knows nothing."""
        return cls(Pose2(0.0, 0.0, 0.0), math.inf, math.pi)

    def holds(self, pose: Pose2) -> bool:
        """Whether a pose lies inside."""
        away = pose.minus(self.centre)
        return math.hypot(away[0], away[1]) <= self.dt_m and abs(away[2]) <= self.dphi_rad


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
    `selected`: map segments tried in the window; `hypotheses`: poses scored; `score`: log-likelihood
    ratio of the best one against chance.
    """

    lines_px: Array = field(default_factory=_no_lines)
    predicted_px: Array = field(default_factory=_no_lines)
    predicted_map: NDArray[np.int64] = field(default_factory=_no_rows)
    matched_map: NDArray[np.int64] = field(default_factory=_no_rows)
    matched_image: NDArray[np.int64] = field(default_factory=_no_rows)
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    selected: int = 0
    hypotheses: int = 0
    score: float = 0.0


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
