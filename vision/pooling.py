"""One image searched in several windows: what was found in each is weighed together."""

from __future__ import annotations

import math
from collections.abc import Sequence

from maps.outcomes import Ambiguous, Fix, NoFix, Outcome, PoseBelief
from vision.decision import DecisionConfig, same_place


def pooled(outcomes: Sequence[Outcome], config: DecisionConfig) -> Outcome:
    """Return the one outcome of looks at one image in several windows (at least one), as `decide` would.

    Scores are log-likelihood ratios of the whole picture against chance, so places compare across windows.
    Where no window has a place, it is the first one's reason.
    """
    found = [outcome for outcome in outcomes if not isinstance(outcome, NoFix)]
    if len(found) <= 1:
        return found[0] if found else outcomes[0]
    best = max(found, key=lambda outcome: outcome.look.score)
    places: list[tuple[PoseBelief, float]] = []
    for outcome in sorted(found, key=lambda outcome: -outcome.look.score):
        weight = math.exp((outcome.look.score - best.look.score) / config.score_temper)
        for belief, odds in _places(outcome):
            if not any(same_place(belief.pose, other.pose, config) for other, _ in places):
                places.append((belief, weight * odds))
    total = sum(odds for _, odds in places)
    shares = sorted(((belief, odds / total) for belief, odds in places), key=lambda place: -place[1])
    if 1.0 - shares[0][1] <= config.max_rival_odds:
        return Fix(shares[0][0], best.look)
    likely = [share for share in shares if share[1] > config.max_rival_odds * shares[0][1]]
    likely = likely[: config.max_places]
    kept = sum(odds for _, odds in likely)
    return Ambiguous(
        tuple(belief for belief, _ in likely), tuple(odds / kept for _, odds in likely), best.look
    )


def _places(outcome: Fix | Ambiguous) -> list[tuple[PoseBelief, float]]:
    if isinstance(outcome, Fix):
        return [(outcome.belief, 1.0)]
    return list(zip(outcome.beliefs, outcome.odds, strict=True))
