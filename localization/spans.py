"""Odometry from node to node of a factor graph: many steps added up to one motion with its errors."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from localization.ekf import Estimate, predict
from localization.odometry import OdometryStep
from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """The motion from one node to the next, as if the first one were the origin.

    `within`: estimates at the ends of odometry's steps on the way; `end`: at the next node. `forgetting`: the
    parameters of the systematic errors keep exp(-forgetting) of their correlation on the way.
    """

    start_ns: int
    within: tuple[Estimate, ...]
    end: Estimate
    forgetting: float

    @property
    def lasting(self) -> Array:
        """What one standard deviation of each parameter adds to the motion, (3, PARAMETERS)."""
        # The parameters are unit normals, so their covariance with the motion is its regression on them.
        return self.end.joint[:3, 3:]

    def moved_by(self, parameters: Array) -> Pose2:
        """Return the motion with the systematic errors that the parameters (PARAMETERS,) tell."""
        return Pose2.from_array(self.end.mean[:3] + self.lasting @ parameters)

    def until(self, stamp_ns: int) -> Pose2:
        """Return the motion up to a stamp inside, linear between odometry's stamps."""
        stamps = [self.start_ns, *(each.stamp_ns for each in self.within)]
        poses = [np.zeros(3), *(each.mean[:3] for each in self.within)]
        if stamps[-1] < self.end.stamp_ns:
            stamps.append(self.end.stamp_ns)
            poses.append(self.end.mean[:3])
        after = min(max(bisect_right(stamps, stamp_ns), 1), len(stamps) - 1)
        share = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return Pose2.from_array(poses[after - 1] + share * (poses[after] - poses[after - 1]))


class SpanChain:
    """Adds steps up to spans: nodes lie at the stamps asked for, and often enough between them."""

    def __init__(self, start_ns: int, spacing_s: float, stamps_ns: Iterable[int] = ()) -> None:
        """Begin at a stamp; `stamps_ns`: where nodes must be, beside one every `spacing_s`."""
        self._asked, self._spacing_ns = sorted(set(stamps_ns)), spacing_s * 1e9
        self._last = OdometryStep(start_ns - 1, start_ns, 0.0, 0.0, np.zeros((2, 2)))
        self._start_ns, self._within, self._forgetting = start_ns, list[Estimate](), 0.0
        self._here = _origin(start_ns)

    def follow(self, step: OdometryStep) -> Iterator[Span]:
        """Add a step and yield the spans that it completes; repeats are left out, holes filled by a guess."""
        for piece in self._last.then(step):
            self._last = piece
            first, end = (bisect_right(self._asked, stamp) for stamp in (piece.start_ns, piece.stamp_ns))
            for cut_ns in sorted({*self._asked[first:end], piece.stamp_ns}):
                part = piece.part(self._here.stamp_ns, cut_ns)
                self._here, self._forgetting = predict(self._here, part), self._forgetting + part.forgetting
                if cut_ns == piece.stamp_ns:
                    self._within.append(self._here)
                if cut_ns - self._start_ns >= self._spacing_ns or self._is_asked(cut_ns):
                    yield self._completed()
                    self._begin(cut_ns)

    def rest(self) -> Iterator[Span]:
        """Yield the last span, if steps are left."""
        if self._within:
            yield self._completed()
            self._begin(self._here.stamp_ns)

    def _begin(self, start_ns: int) -> None:
        self._start_ns, self._within, self._forgetting = start_ns, list[Estimate](), 0.0
        self._here = _origin(start_ns)

    def _completed(self) -> Span:
        return Span(self._start_ns, tuple(self._within), self._here, self._forgetting)

    def _is_asked(self, stamp_ns: int) -> bool:
        found = bisect_right(self._asked, stamp_ns)
        return found > 0 and self._asked[found - 1] == stamp_ns


def _origin(stamp_ns: int) -> Estimate:
    return Estimate.of(PoseBelief(stamp_ns, Pose2(0.0, 0.0, 0.0), np.zeros((3, 3))))


def spans_of(
    start_ns: int, steps: Iterable[OdometryStep], spacing_s: float, stamps_ns: Iterable[int] = ()
) -> list[Span]:
    """Return the spans of all steps, in order and without holes."""
    chain = SpanChain(start_ns, spacing_s, stamps_ns)
    return [span for step in steps for span in chain.follow(step)] + list(chain.rest())


def between_nodes(spans: Sequence[Span], nodes: Sequence[PoseBelief]) -> Iterator[PoseBelief]:
    """Yield the beliefs at odometry's stamps: dead reckoning from node to node.

    What is left at the next node is spread over the time. `nodes`: one more than spans.
    """
    for span, first, second in zip(spans, nodes[:-1], nodes[1:], strict=True):
        left = second.pose.minus(first.pose @ span.end.pose)
        for inside in span.within:
            share = (inside.stamp_ns - span.start_ns) / (span.end.stamp_ns - span.start_ns)
            pose = Pose2.from_array((first.pose @ inside.pose).as_array() + share * left)
            covariance = (1.0 - share) * first.covariance + share * second.covariance
            yield PoseBelief(inside.stamp_ns, pose, covariance)
