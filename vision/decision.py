"""From weighed candidates to an outcome: a fix, several poses that cannot be told apart, or none."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.outcomes import Ambiguous, Fix, Look, NoFix, Outcome, PoseBelief, Reason
from maps.poses import Array, Pose2
from vision.refinement import Candidate


@dataclass(frozen=True, slots=True)
class DecisionConfig:
    """When to believe."""

    #: A fix needs this much evidence over chance (nats), and this many different segments.
    min_score: float = 10.0
    #: And this many times the logarithm of the number of poses that were tried.
    tried_weight: float = 2.7
    min_matched: int = 6
    #: Poses this near each other are one place; their spread goes into the covariance.
    same_place_m: float = 0.30
    same_place_rad: float = math.radians(5.0)
    #: No more places than this are told apart; the rest of the odds is spread over them.
    max_places: int = 5
    #: Other places with more than this share of the odds make the image ambiguous.
    max_rival_odds: float = 0.05
    #: The looks at an image are not independent: log-odds between poses are divided by this.
    score_temper: float = 4.0


def decide(candidates: list[Candidate], look: Look, tried: float, config: DecisionConfig) -> Outcome:
    """Weigh the candidates, best first (at least one).

    `tried`: how many different poses the window held. The more, the better the best of them looks by accident.
    """
    best = candidates[0]
    needed = max(config.min_score, config.tried_weight * math.log(tried))
    if best.score < needed or best.matched_segments < config.min_matched:
        return NoFix(Reason.WEAK_EVIDENCE, look)
    odds = np.exp((np.array([c.score for c in candidates]) - best.score) / config.score_temper)
    odds /= odds.sum()
    places = _places([candidate.belief for candidate in candidates], odds, config)
    if 1.0 - places[0][1] <= config.max_rival_odds:
        return Fix(places[0][0], look)
    likely = [place for place in places if place[1] > config.max_rival_odds * places[0][1]]
    likely = likely[: config.max_places]
    total = sum(share for _, share in likely)
    return Ambiguous(tuple(belief for belief, _ in likely), tuple(share / total for _, share in likely), look)


def _places(beliefs: list[PoseBelief], odds: Array, config: DecisionConfig) -> list[tuple[PoseBelief, float]]:
    """Beliefs, best first, merged where they are one place, each with its odds; the likeliest place first."""
    left = list(range(len(beliefs)))
    places = []
    while left:
        here = [k for k in left if same_place(beliefs[k].pose, beliefs[left[0]].pose, config)]
        left = [k for k in left if k not in here]
        places.append((_moment_match([beliefs[k] for k in here], odds[here]), float(odds[here].sum())))
    return sorted(places, key=lambda place: -place[1])


def same_place(pose: Pose2, other: Pose2, config: DecisionConfig) -> bool:
    """Tell whether two poses are so near each other that they count as one place."""
    away = pose.minus(other)
    return math.hypot(away[0], away[1]) <= config.same_place_m and abs(away[2]) <= config.same_place_rad


def _moment_match(beliefs: list[PoseBelief], odds: Array) -> PoseBelief:
    """The Gaussian with the mean and covariance of a mixture of nearby beliefs, best first.

    Swapped door edges give poses a few centimetres apart with like evidence: their spread belongs into
    the covariance.
    """
    if len(beliefs) == 1:
        return beliefs[0]
    weights = odds / odds.sum()
    anchor = beliefs[0]
    away = np.array([belief.pose.minus(anchor.pose) for belief in beliefs])
    mean = weights @ away
    spread = away - mean
    covariance = np.einsum("k,kij->ij", weights, np.array([belief.covariance for belief in beliefs]))
    covariance = covariance + np.einsum("k,ki,kj->ij", weights, spread, spread)
    return PoseBelief(anchor.stamp_ns, Pose2.from_array(anchor.pose.as_array() + mean), covariance)
