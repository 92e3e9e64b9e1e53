"""How well the robot knows where it is, and why it doubts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from localization.trust import Mind
from localization.window import heading_radius, position_radius
from maps.outcomes import PoseBelief


class State(StrEnum):
    """How well the robot knows where it is.

    TRACKING: nothing speaks against the published pose. UNCERTAIN: published, and some `Doubt` about it.
    LOST: nothing is published.
    """

    TRACKING = "TRACKING"
    UNCERTAIN = "UNCERTAIN"
    LOST = "LOST"


class Doubt(StrEnum):
    """Why a robot is not tracking.

    NO_PLACE: no place is trusted. NO_UPDATE: no look was fused for long. ELLIPSE: the covariance is large.
    CONTRADICTED: looks do not show what should be seen, or show other places. UNEXPLAINED: none of the last
    looks was fused, though there was something to see. STRAINED: fixes lie farther from the pose than both promise.
    """

    NO_PLACE = "NO_PLACE"
    NO_UPDATE = "NO_UPDATE"
    ELLIPSE = "ELLIPSE"
    CONTRADICTED = "CONTRADICTED"
    UNEXPLAINED = "UNEXPLAINED"
    STRAINED = "STRAINED"


@dataclass(frozen=True, slots=True)
class StateConfig:
    """When tracking becomes doubtful.

    `limit_m`, `limit_rad`: radii of position and heading that hold the truth with `probability`; a
    passage's half width, and what turns a robot out of it. `limit_s`: without a fused look; a belief
    that none confirms is only dead reckoning, however small its covariance. `sure`: the probability below
    which the place itself is doubtful. `unexplained`: so many looks on end that were not fused make it
    doubtful, whatever they say.
    """

    probability: float = 0.999
    limit_m: float = 0.5
    limit_rad: float = math.radians(10.0)
    limit_s: float = 10.0
    sure: float = 0.8
    unexplained: float = 3.0


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The state, and what it rests on; figures are of the leading place, None where there is none.

    `radius_m`, `radius_rad`: position and heading are that certain. `probability`: that this place is the
    right one. `places`: how many compete. `silent_s`: since a look was fused. `misses`: looks on end since
    then; `unexplained`: those with something to see.
    """

    state: State
    doubts: tuple[Doubt, ...]
    radius_m: float | None
    radius_rad: float | None
    probability: float | None
    places: int
    silent_s: float | None
    misses: int
    unexplained: float


def diagnose(mind: Mind, stamp_ns: int, config: StateConfig) -> Diagnosis:
    """Tell how well the pose is known, by what is known at a stamp."""
    place, counts = mind.leading, (mind.misses, mind.unexplained)
    if place is None:
        return Diagnosis(State.LOST, (Doubt.NO_PLACE,), None, None, None, 0, None, *counts)
    belief = place.estimate.belief
    radius_m, radius_rad = _radii(belief, config)
    silent_s = (stamp_ns - place.fused_ns) * 1e-9
    signs = {
        Doubt.NO_PLACE: not mind.trusted,
        Doubt.NO_UPDATE: silent_s > config.limit_s,
        Doubt.ELLIPSE: radius_m > config.limit_m or radius_rad > config.limit_rad,
        Doubt.CONTRADICTED: place.weight < config.sure,
        Doubt.UNEXPLAINED: mind.unexplained >= config.unexplained,
        Doubt.STRAINED: mind.strained,
    }
    doubts = tuple(doubt for doubt, shown in signs.items() if shown)
    published = State.UNCERTAIN if doubts else State.TRACKING
    return Diagnosis(
        published if mind.trusted else State.LOST,
        doubts,
        radius_m,
        radius_rad,
        place.weight,
        len(mind.hypotheses.places),
        silent_s,
        *counts,
    )


def _radii(belief: PoseBelief, config: StateConfig) -> tuple[float, float]:
    covariance = belief.covariance
    return (
        position_radius(covariance[:2, :2], config.probability),
        heading_radius(covariance[2, 2], config.probability),
    )
