"""One image, searched in every window that a localizer asks for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from maps.outcomes import Outcome, SearchWindow
from vision.images import GreyImage
from vision.matcher import LineMatcher
from vision.pooling import pooled


def look_in(
    matcher: LineMatcher, image: GreyImage, stamp_ns: int, windows: Sequence[SearchWindow]
) -> tuple[Outcome, Mapping[str, float]]:
    """Match an image inside each window; the outcome of all, and the milliseconds it took, by stage."""
    outcomes, spent_ms = [], Counter[str]()
    for window in windows:
        outcomes.append(matcher.match(image, stamp_ns, window))
        spent_ms.update(matcher.timing_ms)
    return (outcomes[0] if len(outcomes) == 1 else pooled(outcomes, matcher.config.decision)), spent_ms
