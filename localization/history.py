"""The recent past, kept so that a late fix is fused at its own stamp and the rest replayed.

The belief after each odometry step is a pure function of the belief before it, the step and the fixes
inside it. A late fix runs that function again from its step on: whatever the order of arrival, the
result is the same, bit for bit.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from localization.ekf import Estimate, innovation, predict, update
from localization.odometry import OdometryStep
from localization.verdicts import Fused, Refusal, Rejected
from maps.outcomes import PoseBelief

FixVerdict = Fused | Rejected


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    """One odometry step, the fixes inside it in order, and what they made of the belief before it.

    `fused_ns`: stamp of the newest fix fused up to its end.
    """

    before: Estimate
    step: OdometryStep
    fixes: tuple[PoseBelief, ...]
    after: Estimate
    verdicts: tuple[FixVerdict, ...]
    fused_ns: int


def order_of(fix: PoseBelief) -> tuple[int, bytes, bytes]:
    """Return a sort key: by stamp, equal stamps by content, never by arrival."""
    return fix.stamp_ns, fix.pose.as_array().tobytes(), fix.covariance.tobytes()


class History:
    """Odometry steps and fixes of the last `span_ns`, and the belief that they lead to."""

    def __init__(
        self, anchor: PoseBelief, gate: float, span_ns: float, fixes: Iterable[PoseBelief] = ()
    ) -> None:
        """Begin at a belief; `gate`: probability that a good fix passes; `fixes` yet to be reached."""
        self._gate, self._span_ns = gate, span_ns
        self._pending = sorted(fixes, key=order_of)
        # A motionless leg before the anchor: fixes at the anchor's own stamp need no special case.
        before = Estimate.of(PoseBelief(anchor.stamp_ns - 1, anchor.pose, anchor.covariance))
        still = OdometryStep(before.stamp_ns, anchor.stamp_ns, 0.0, 0.0, np.zeros((2, 2)))
        self._fused_before_ns = anchor.stamp_ns
        self._legs = [self._run(before, still, self._take_pending(anchor.stamp_ns), anchor.stamp_ns)]

    @property
    def steps(self) -> list[OdometryStep]:
        """The steps of the history, oldest first, without holes."""
        return [leg.step for leg in self._legs]

    @property
    def belief(self) -> PoseBelief:
        """The newest belief: after all odometry, and after all fixes that are newer still."""
        newest = self._pending[-1].stamp_ns if self._pending else self._end_ns
        return self._belief_from(self._legs[-1].after, newest)

    @property
    def fused_ns(self) -> int:
        """The stamp of the newest fix fused, or of the first belief where there was none."""
        return self._legs[-1].fused_ns

    def append(self, step: OdometryStep) -> None:
        """Add odometry; what it repeats is left out, what is missing before it is guessed."""
        for piece in self._legs[-1].step.then(step):
            last = self._legs[-1]
            fixes = self._take_pending(piece.stamp_ns)
            self._legs.append(self._run(last.after, piece, fixes, last.fused_ns))
        self._prune()

    def keep(self, span_ns: float) -> None:
        """Keep from now on only what is that much older than the newest odometry."""
        self._span_ns = span_ns
        self._prune()

    def insert(self, fix: PoseBelief) -> FixVerdict:
        """Fuse a fix at its own stamp, and replay what came after it."""
        if fix.stamp_ns <= self._legs[0].step.start_ns:
            return Rejected(Refusal.TOO_OLD)
        if fix.stamp_ns > self._end_ns + self._span_ns:
            return Rejected(Refusal.TOO_NEW)
        if fix.stamp_ns > self._end_ns:
            return self._insert_pending(fix)
        first = self._index(fix.stamp_ns)
        fixes = tuple(sorted((*self._legs[first].fixes, fix), key=order_of))
        self._replay(first, fixes)
        return self._legs[first].verdicts[fixes.index(fix)]

    def verdict_of(self, fix: PoseBelief) -> FixVerdict:
        """Return what became of a fix inserted before; too old where the history has left it behind."""
        reached = fix.stamp_ns <= self._end_ns
        for leg in self._legs if reached else [self._guess(fix.stamp_ns)]:
            if fix in leg.fixes:
                return leg.verdicts[leg.fixes.index(fix)]
        return Rejected(Refusal.TOO_OLD)

    def belief_at(self, stamp_ns: int) -> PoseBelief | None:
        """Return the belief at a stamp, with all fixes up to it; None before the history begins."""
        if stamp_ns <= self._legs[0].step.start_ns:
            return None
        if stamp_ns >= self._end_ns:
            return self._belief_from(self._legs[-1].after, stamp_ns)
        leg = self._legs[self._index(stamp_ns)]
        if stamp_ns == leg.step.stamp_ns:
            return leg.after.belief
        fixes = tuple(fix for fix in leg.fixes if fix.stamp_ns <= stamp_ns)
        return self._run(leg.before, leg.step.part(leg.step.start_ns, stamp_ns), fixes, 0).after.belief

    @property
    def _end_ns(self) -> int:
        return self._legs[-1].step.stamp_ns

    def _prune(self) -> None:
        oldest_ns = self._end_ns - self._span_ns
        gone = next(i for i, leg in enumerate(self._legs) if leg.step.stamp_ns >= oldest_ns)
        if gone:
            self._fused_before_ns = self._legs[gone - 1].fused_ns
            del self._legs[:gone]

    def _index(self, stamp_ns: int) -> int:
        return bisect_left(self._legs, stamp_ns, key=lambda leg: leg.step.stamp_ns)

    def _take_pending(self, until_ns: int) -> tuple[PoseBelief, ...]:
        count = sum(fix.stamp_ns <= until_ns for fix in self._pending)
        taken = tuple(self._pending[:count])
        del self._pending[:count]
        return taken

    def _insert_pending(self, fix: PoseBelief) -> FixVerdict:
        """Judge a fix that odometry has not reached on a guess of it; the replay will judge again."""
        insort(self._pending, fix, key=order_of)
        return self.verdict_of(fix)

    def _belief_from(self, last: Estimate, stamp_ns: int) -> PoseBelief:
        return (last if stamp_ns == last.stamp_ns else self._guess(stamp_ns).after).belief

    def _guess(self, stamp_ns: int) -> _Leg:
        last = self._legs[-1]
        fixes = tuple(fix for fix in self._pending if fix.stamp_ns <= stamp_ns)
        return self._run(last.after, last.step.continued(stamp_ns), fixes, last.fused_ns)

    def _replay(self, first: int, fixes: tuple[PoseBelief, ...]) -> None:
        leg = self._legs[first]
        fused_ns = self._legs[first - 1].fused_ns if first else self._fused_before_ns
        self._legs[first] = self._run(leg.before, leg.step, fixes, fused_ns)
        for i in range(first + 1, len(self._legs)):
            last, leg = self._legs[i - 1], self._legs[i]
            self._legs[i] = self._run(last.after, leg.step, leg.fixes, last.fused_ns)

    def _run(
        self, before: Estimate, step: OdometryStep, fixes: tuple[PoseBelief, ...], fused_ns: int
    ) -> _Leg:
        """Predict to each fix inside the step, gate it, fuse it; then predict to the step's end."""
        estimate, verdicts = before, list[FixVerdict]()
        for fix in fixes:
            estimate = self._predict(estimate, step, fix.stamp_ns)
            news = innovation(estimate, fix)
            if news.inside(self._gate):
                estimate, fused_ns = update(estimate, fix, news), fix.stamp_ns
                verdicts.append(Fused(news.nis))
            else:
                verdicts.append(Rejected(Refusal.GATE, news.nis))
        after = self._predict(estimate, step, step.stamp_ns)
        return _Leg(before, step, fixes, after, tuple(verdicts), fused_ns)

    @staticmethod
    def _predict(estimate: Estimate, step: OdometryStep, stamp_ns: int) -> Estimate:
        if stamp_ns == estimate.stamp_ns:
            return estimate
        return predict(estimate, step.part(estimate.stamp_ns, stamp_ns))
