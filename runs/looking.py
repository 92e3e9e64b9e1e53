"""One image, searched in every window that a localizer asks for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from maps.outcomes import NoFix, Outcome, SearchWindow
from vision.images import GreyImage
from vision.matcher import LineMatcher
from vision.pooling import pooled

Windows = tuple[SearchWindow, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """What came of one image: the outcome, the widest window searched, the milliseconds it took, by stage."""

    outcome: Outcome
    window: SearchWindow
    spent_ms: Mapping[str, float]


def look_in(
    matcher: LineMatcher, image: GreyImage, stamp_ns: int, windows: Windows, otherwise: Windows = ()
) -> Looked:
    """Match an image inside each window, and weigh together what was found.

    Where there is no place in any of them, it is searched in those of `otherwise` too.
    """
    spent_ms, searched = Counter[str](), list[SearchWindow]()

    def outcome_in(tried: Windows) -> Outcome:
        outcomes = []
        for window in tried:
            outcomes.append(matcher.match(image, stamp_ns, window))
            spent_ms.update(matcher.timing_ms)
        searched.extend(tried)
        return outcomes[0] if len(outcomes) == 1 else pooled(outcomes, matcher.config.decision)

    outcome = outcome_in(windows)
    if otherwise and isinstance(outcome, NoFix):
        again = outcome_in(otherwise)
        outcome = outcome if isinstance(again, NoFix) else again
    return Looked(outcome, max(searched, key=lambda window: window.dt_m), spent_ms)
