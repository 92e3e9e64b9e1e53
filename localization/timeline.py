"""The recent past, kept so that a late look is taken at its own stamp and the rest replayed.

What is known after each odometry step is a pure function of what was known before it, the step and the looks
inside it. A late look runs that function again from its step on: whatever the order of arrival, the result is the
same, bit for bit, with one place or several, trusted or not.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from localization.hypotheses import HypothesesConfig
from localization.odometry import OdometryStep
from localization.sightings import Sighting
from localization.trust import Mind, TrustConfig
from localization.verdicts import Missed, Refusal, Rejected, Verdict

_ORDER: Callable[[Sighting], tuple[object, ...]] = attrgetter("order")


@dataclass(frozen=True, slots=True)
class TimelineConfig:
    """What the replayed function is made of. `gate`: probability that a good fix passes; `span_ns`: kept."""

    gate: float
    span_ns: float
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    trust: TrustConfig = field(default_factory=TrustConfig)


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    """One odometry step, the looks inside it in order, and what they made of the mind before it."""

    before: Mind
    step: OdometryStep
    looks: tuple[Sighting, ...]
    after: Mind
    verdicts: tuple[Verdict, ...]


class Timeline:
    """Odometry steps and looks of the last `span_ns`, and the mind that they lead to."""

    def __init__(
        self, start_ns: int, mind: Mind, config: TimelineConfig, looks: Iterable[Sighting] = ()
    ) -> None:
        """Begin with a mind at a stamp; `looks` yet to be reached."""
        self._config = config
        self._pending = sorted(looks, key=_ORDER)
        # A motionless leg before the start: looks at its own stamp need no special case.
        still = OdometryStep(start_ns - 1, start_ns, 0.0, 0.0, np.zeros((2, 2)))
        self._legs = [self._run(mind, still, self._take_pending(start_ns))]

    @property
    def steps(self) -> list[OdometryStep]:
        """The steps kept, oldest first, without holes."""
        return [leg.step for leg in self._legs]

    @property
    def end_ns(self) -> int:
        """The stamp that odometry has reached."""
        return self._legs[-1].step.stamp_ns

    @property
    def newest_ns(self) -> int:
        """The newest stamp of odometry and looks."""
        return self._pending[-1].stamp_ns if self._pending else self.end_ns

    def append(self, step: OdometryStep) -> None:
        """Add odometry; what it repeats is left out, what is missing before it is guessed."""
        for piece in self._legs[-1].step.then(step):
            self._legs.append(self._run(self._legs[-1].after, piece, self._take_pending(piece.stamp_ns)))
        self._prune()

    def keep(self, span_ns: float) -> None:
        """Keep from now on only what is that much older than the newest odometry."""
        self._config = TimelineConfig(self._config.gate, span_ns, self._config.hypotheses, self._config.trust)
        self._prune()

    def insert(self, look: Sighting) -> Verdict:
        """Take a look at its own stamp, and replay what came after it."""
        if look.stamp_ns <= self._legs[0].step.start_ns:
            return self._untimely(look, Refusal.TOO_OLD)
        if look.stamp_ns > self.end_ns + self._config.span_ns:
            return self._untimely(look, Refusal.TOO_NEW)
        if look.stamp_ns > self.end_ns:
            # Judged on a guess of the odometry to come; the replay will judge again.
            insort(self._pending, look, key=_ORDER)
            return self.verdict_of(look)
        first = self._index(look.stamp_ns)
        looks = tuple(sorted((*self._legs[first].looks, look), key=_ORDER))
        self._replay(first, looks)
        return self._legs[first].verdicts[looks.index(look)]

    def verdict_of(self, look: Sighting) -> Verdict:
        """Return what became of a look inserted before; too old where the timeline has left it behind."""
        reached = look.stamp_ns <= self.end_ns
        for leg in self._legs if reached else [self._guess(look.stamp_ns)]:
            if look in leg.looks:
                return leg.verdicts[leg.looks.index(look)]
        return self._untimely(look, Refusal.TOO_OLD)

    def mind_at(self, stamp_ns: int) -> Mind | None:
        """Return what is known of a stamp, by all looks up to it; None before the timeline begins."""
        if stamp_ns <= self._legs[0].step.start_ns:
            return None
        if stamp_ns > self.end_ns:
            return self._guess(stamp_ns).after
        leg = self._legs[self._index(stamp_ns)]
        if stamp_ns == leg.step.stamp_ns:
            return leg.after
        looks = tuple(look for look in leg.looks if look.stamp_ns <= stamp_ns)
        return self._run(leg.before, leg.step.part(leg.step.start_ns, stamp_ns), looks).after

    @staticmethod
    def _untimely(look: Sighting, refusal: Refusal) -> Verdict:
        return Rejected(refusal) if len(look.places) == 1 else Missed(look.unused)

    def _prune(self) -> None:
        oldest_ns = self.end_ns - self._config.span_ns
        gone = next(i for i, leg in enumerate(self._legs) if leg.step.stamp_ns >= oldest_ns)
        del self._legs[:gone]

    def _index(self, stamp_ns: int) -> int:
        return bisect_left(self._legs, stamp_ns, key=lambda leg: leg.step.stamp_ns)

    def _take_pending(self, until_ns: int) -> tuple[Sighting, ...]:
        count = sum(look.stamp_ns <= until_ns for look in self._pending)
        taken = tuple(self._pending[:count])
        del self._pending[:count]
        return taken

    def _guess(self, stamp_ns: int) -> _Leg:
        last = self._legs[-1]
        looks = tuple(look for look in self._pending if look.stamp_ns <= stamp_ns)
        return self._run(last.after, last.step.continued(stamp_ns), looks)

    def _replay(self, first: int, looks: tuple[Sighting, ...]) -> None:
        leg = self._legs[first]
        if len(looks) == 1 and looks[0].stamp_ns == leg.step.stamp_ns:
            # The way to the end of a step is known: the same, bit for bit, in half the time.
            mind, verdict = self._seen(leg.after, looks[0])
            self._legs[first] = _Leg(leg.before, leg.step, looks, mind, (verdict,))
        else:
            self._legs[first] = self._run(leg.before, leg.step, looks)
        for i in range(first + 1, len(self._legs)):
            leg = self._legs[i]
            self._legs[i] = self._run(self._legs[i - 1].after, leg.step, leg.looks)

    def _run(self, before: Mind, step: OdometryStep, looks: tuple[Sighting, ...]) -> _Leg:
        """Move to each look inside the step and take it; then move to the step's end."""
        mind, here_ns = before, step.start_ns
        verdicts = list[Verdict]()
        for look in looks:
            mind, here_ns = self._moved(mind, step, here_ns, look.stamp_ns), look.stamp_ns
            mind, verdict = self._seen(mind, look)
            verdicts.append(verdict)
        after = self._moved(mind, step, here_ns, step.stamp_ns)
        return _Leg(before, step, looks, after, tuple(verdicts))

    def _seen(self, mind: Mind, look: Sighting) -> tuple[Mind, Verdict]:
        return mind.seen(look, self._config.gate, self._config.hypotheses, self._config.trust)

    def _moved(self, mind: Mind, step: OdometryStep, start_ns: int, stamp_ns: int) -> Mind:
        if start_ns == stamp_ns:
            return mind
        return mind.moved(step.part(start_ns, stamp_ns), self._config.hypotheses)
