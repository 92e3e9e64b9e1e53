"""A look at the world as evidence: the places that it may have been taken from, or what speaks against all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from localization.verdicts import Unused
from maps.outcomes import Ambiguous, Fix, Look, NoFix, Outcome, PoseBelief, Reason, SearchWindow

#: Of an image without lines; and besides, of one that fits but tells too little.
_BLIND = (Reason.UNREADABLE_IMAGE, Reason.TOO_FEW_SEGMENTS)
_NEUTRAL = (*_BLIND, Reason.WEAK_GEOMETRY)


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """What a look is worth.

    `wide_m`: beyond this a window is a search for a place, be it of the floor or of a metre around.
    `miss`: an image that shows nothing where at least `plenty` edges should be seen is so much less likely
    at the right place than at another one; people and open doors hide much. `floor_miss`: the same for an
    image that a search found no place for, which says more about the image. `clear_miss`: the same where it shows at
    least as many lines as edges are expected, `clear` of them or more, and less than `clear_share` of these: there is
    enough to see, and it is something else.
    """

    wide_m: float = 0.9
    plenty: int = 8
    miss: float = 0.25
    floor_miss: float = 0.9
    clear: int = 20
    clear_share: float = 0.45
    clear_miss: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What a look says: `places` with their `odds` (both empty where it found none).

    `doubt`: without places, the factor of likelihood for all hypotheses, 1 where the look says nothing;
    None where the places compete with them. `blind`: nothing was to be seen, as by a
    covered camera. `unused`: the reason to give where it was not fused.
    """

    stamp_ns: int
    places: tuple[PoseBelief, ...]
    odds: tuple[float, ...]
    doubt: float | None
    unused: Reason | Unused
    blind: bool = False

    @property
    def order(self) -> tuple[int, int, bytes, tuple[float, ...], str, float]:
        """A sort key: by stamp, equal stamps by content, never by arrival."""
        content = b"".join(p.pose.as_array().tobytes() + p.covariance.tobytes() for p in self.places)
        doubt = 0.0 if self.doubt is None else self.doubt
        return self.stamp_ns, len(self.places), content, self.odds, self.unused.value, doubt


def sighting_of(
    outcome: Outcome, stamp_ns: int, window: SearchWindow | None, config: EvidenceConfig
) -> Sighting:
    """Weigh the outcome of a look; `stamp_ns` and `window`: of the image, None where nothing was searched.

    A look with places has their stamp.
    """
    match outcome:
        case NoFix(reason=reason):
            wide = window is not None and window.dt_m > config.wide_m
            return Sighting(stamp_ns, (), (), _doubt(outcome, wide, config), reason, reason in _BLIND)
        case Fix(belief=belief):
            return Sighting(belief.stamp_ns, (belief,), (1.0,), None, Unused.UNCONFIRMED)
        case Ambiguous(beliefs=beliefs, odds=odds):
            return Sighting(beliefs[0].stamp_ns, beliefs, odds, None, Unused.AMBIGUOUS)


def _doubt(outcome: NoFix, wide: bool, config: EvidenceConfig) -> float:
    if outcome.reason in _NEUTRAL or len(outcome.look.predicted_px) < config.plenty:
        return 1.0
    if not wide:
        return config.miss
    return config.clear_miss if _shows_something_else(outcome.look, config) else config.floor_miss


def _shows_something_else(look: Look, config: EvidenceConfig) -> bool:
    """Whether an image that is rich in lines lacks most of the edges that should be seen."""
    expected, seen = len(np.unique(look.predicted_map)), len(np.unique(look.matched_map))
    return config.clear <= expected <= len(look.lines_px) and seen < config.clear_share * expected
