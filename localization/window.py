"""Where the next image should be searched, and how well the robot knows its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from localization.ekf import quantile
from maps.outcomes import PoseBelief, SearchWindow
from maps.poses import Array, Pose2


class State(StrEnum):
    """How well the robot knows where it is."""

    TRACKING = "TRACKING"
    UNCERTAIN = "UNCERTAIN"
    LOST = "LOST"


@dataclass(frozen=True, slots=True)
class WindowConfig:
    """How a belief becomes a search window (paper, section 3.2).

    `probability`: that the true pose lies within the position radius, and within the heading's.
    `floor_m`, `floor_rad`: least half-widths; below them a search is not faster, and what the filter
    believes is not that exact. `growth`: by this factor after each frame without a fix, since then
    the belief itself is in doubt, up to `largest_growth`.
    """

    probability: float = 0.999
    floor_m: float = 0.15
    floor_rad: float = math.radians(3.0)
    growth: float = 1.4
    largest_growth: float = 5.0


@dataclass(frozen=True, slots=True)
class StateConfig:
    """When tracking becomes doubtful.

    `limit_m`, `limit_rad`: radii of position and heading that hold the truth with `probability`; a
    passage's half width, and what turns a robot out of it. `limit_s`: without a fused fix; a belief
    that no fix confirms is only dead reckoning, however small its covariance.
    """

    probability: float = 0.999
    limit_m: float = 0.5
    limit_rad: float = math.radians(10.0)
    limit_s: float = 10.0


def position_radius(covariance: Array, probability: float) -> float:
    """Return the radius of the circle about the probability ellipse of a position covariance (2, 2)."""
    widest = float(np.linalg.eigvalsh(covariance)[-1])
    return math.sqrt(quantile(probability, 2) * max(widest, 0.0))


def heading_radius(variance: float, probability: float) -> float:
    """Return the half-width of a heading's interval of this probability."""
    return math.sqrt(quantile(probability, 1) * variance)


def search_window(belief: PoseBelief, misses: int, config: WindowConfig) -> SearchWindow:
    """Return the window about a belief after so many frames without a fix."""
    growth = min(config.growth**misses, config.largest_growth)
    dt_m = position_radius(belief.covariance[:2, :2], config.probability)
    dphi_rad = heading_radius(belief.covariance[2, 2], config.probability)
    return SearchWindow(
        belief.pose,
        growth * max(dt_m, config.floor_m),
        min(growth * max(dphi_rad, config.floor_rad), math.pi),
    )


#: Being lost is only a large window: anywhere, in any direction.
ANYWHERE = SearchWindow(Pose2(0.0, 0.0, 0.0), math.inf, math.pi)


def state_of(belief: PoseBelief, fused_ns: int, config: StateConfig) -> State:
    """Tell whether a belief, last confirmed by a fix at `fused_ns`, can be trusted."""
    known = (
        position_radius(belief.covariance[:2, :2], config.probability) <= config.limit_m
        and heading_radius(belief.covariance[2, 2], config.probability) <= config.limit_rad
    )
    confirmed = (belief.stamp_ns - fused_ns) * 1e-9 <= config.limit_s
    return State.TRACKING if known and confirmed else State.UNCERTAIN
