"""A run looked back upon: smoothed stretch by stretch, and the frames without a fix matched again."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from operator import attrgetter

import numpy as np

from localization.ekf import Estimate, innovation, predict
from localization.odometry import OdometryStep
from localization.smoother import SmootherConfig, smooth
from maps.outcomes import PoseBelief
from runs.config import RunConfig
from runs.parts import Part, parts_of
from runs.secondpass import Look, SecondPass, second_pass
from runs.session import Frame

#: Of a fix that is dead-reckoned to where the robot found itself again, and must fit there.
_GATE = 0.999
#: Variances of a start that nobody knows [m^2, m^2, rad^2].
_ANYWHERE = np.diag([1e4, 1e4, 10.0])


def smoothed_in_parts(
    account: Account,
    missed: Sequence[Frame],
    look: Look | None,
    config: RunConfig,
    progress: Callable[[int, int], None],
) -> Iterator[tuple[list[PoseBelief], SecondPass]]:
    """Smooth a drive of any length, and yield what each part tells, in order of time.

    A drive that is cut tells its progress by parts.
    """
    parts = parts_of(account.start.stamp_ns, account.end_ns, config.parts)
    for done, part in enumerate(parts, start=1):
        frames = [frame for frame in missed if part.tells_of(frame.stamp_ns)]
        beliefs, again = smoothed_twice(account.of(part), frames, look, config)
        yield [belief for belief in beliefs if part.tells_of(belief.stamp_ns)], again
        if len(parts) > 1:
            progress(done, len(parts))


def smoothed_twice(
    account: Account, missed: Sequence[Frame], look: Look | None, config: RunConfig
) -> tuple[list[PoseBelief], SecondPass]:
    """Smooth, match the frames without a fix again inside small windows, and smooth with what they brought.

    `look`: None where there are no images to match. Returns beliefs in order of time.
    """
    stretches = account.stretches()
    smoothed = [stretch.smoothed((), config.smoother) for stretch in stretches]
    again = SecondPass()
    if look is not None and config.second_pass.enabled:
        beliefs = list(chain.from_iterable(smoothed))
        again = second_pass(missed, beliefs, look, config.second_pass, config.localizer.window)
        more = [fix.belief for fix in again.fixes]
        smoothed = [
            stretch.smoothed(more, config.smoother) if stretch.inside(more) else before
            for stretch, before in zip(stretches, smoothed, strict=True)
        ]
    return list(chain.from_iterable(smoothed)), again


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A part of the drive that odometry holds together; what `localization.smoother.smooth` takes.

    `end_ns`: the beginning of the next one, None for the last.
    """

    initial: PoseBelief
    steps: tuple[OdometryStep, ...]
    fixes: tuple[PoseBelief, ...]
    guess: tuple[PoseBelief, ...]
    end_ns: int | None = None

    def smoothed(self, more: Sequence[PoseBelief], config: SmootherConfig) -> tuple[PoseBelief, ...]:
        """Smooth it, with more fixes where they lie inside."""
        fixes = (*self.fixes, *self.inside(more))
        beliefs = smooth(self.initial, self.steps, fixes, config, self.guess).beliefs
        return tuple(belief for belief in beliefs if self._before_end(belief.stamp_ns))

    def inside(self, fixes: Sequence[PoseBelief]) -> list[PoseBelief]:
        """Return those fixes whose stamps lie inside."""
        begin_ns = self.initial.stamp_ns
        return [fix for fix in fixes if begin_ns <= fix.stamp_ns and self._before_end(fix.stamp_ns)]

    def _before_end(self, stamp_ns: int) -> bool:
        return self.end_ns is None or stamp_ns < self.end_ns


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """What a run wrote down: odometry, all fixes and the published beliefs, each in order of time.

    `start`: where the first stretch begins. `fused_ns`: stamps of the looks that were accepted. `relocalized`:
    the beliefs just after the robot found itself at another place than it believed.
    """

    start: PoseBelief
    steps: Sequence[OdometryStep]
    fixes: Sequence[PoseBelief]
    published: Sequence[PoseBelief]
    fused_ns: Sequence[int] = ()
    relocalized: Sequence[PoseBelief] = ()

    @property
    def end_ns(self) -> int:
        """The last step's end."""
        return self.steps[-1].stamp_ns if len(self.steps) else self.start.stamp_ns

    def of(self, part: Part) -> Account:
        """Return what a part is worked out from.

        It starts at what the filter believed there, which knows all fixes before.
        """
        start, published = self.start, 0
        if part.from_ns is not None:
            published = bisect_right(self.published, part.from_ns, key=attrgetter("stamp_ns"))
            start = self.published[published - 1] if published else self.start
        inner = start is not self.start
        until_ns = math.inf if part.until_ns is None else part.until_ns

        def inside(stamp_ns: int) -> bool:
            return (stamp_ns > start.stamp_ns or not inner) and stamp_ns < until_ns

        first = bisect_left(self.steps, start.stamp_ns, key=attrgetter("start_ns"))
        last = bisect_left(self.steps, until_ns, key=attrgetter("start_ns"))
        told = bisect_left(self.published, until_ns, key=attrgetter("stamp_ns"))
        return Account(
            start,
            tuple(self.steps[first:last]),
            tuple(fix for fix in self.fixes if inside(fix.stamp_ns)),
            tuple(self.published[published:told]),
            tuple(filter(inside, self.fused_ns)),
            tuple(belief for belief in self.relocalized if inside(belief.stamp_ns)),
        )

    def stretches(self) -> list[Stretch]:
        """Cut the drive where the robot was carried off, or its wheels let it down."""
        begins = [(self.start.stamp_ns, self.start)]
        for found in sorted(self.relocalized, key=lambda belief: belief.stamp_ns):
            # The first place that a robot finds, being lost, is no other than it believed.
            if found.stamp_ns > self.start.stamp_ns:
                begin_ns = self._begin_ns(found)
                if begin_ns > begins[-1][0]:
                    begins.append((begin_ns, found))
        ends = [*(begin_ns for begin_ns, _ in begins[1:]), None]
        return [self._stretch(*begin, end_ns) for begin, end_ns in zip(begins, ends, strict=True)]

    def _begin_ns(self, found: PoseBelief) -> int:
        """Return the stamp of the first fix that odometry leads from to where the robot found itself."""
        last_ns = max((ns for ns in self.fused_ns if ns < found.stamp_ns), default=self.start.stamp_ns)
        for fix in self.fixes:
            if last_ns < fix.stamp_ns < found.stamp_ns and fix.measured.all():
                estimate = Estimate.of(fix)
                for step in _between(self.steps, fix.stamp_ns, found.stamp_ns):
                    estimate = predict(estimate, step)
                if innovation(estimate, found).inside(_GATE):
                    return fix.stamp_ns
        return found.stamp_ns

    def _stretch(self, begin_ns: int, found: PoseBelief, end_ns: int | None) -> Stretch:
        """Return what lies from one stamp to before another one, or to the end."""

        def before_end(stamp_ns: int) -> bool:
            return end_ns is None or stamp_ns < end_ns

        last_ns = end_ns or max((step.stamp_ns for step in self.steps[-1:]), default=begin_ns)
        carried_off = begin_ns > self.start.stamp_ns
        later = (belief for belief in self.published if belief.stamp_ns > found.stamp_ns)
        return Stretch(
            PoseBelief(begin_ns, found.pose, _ANYWHERE) if carried_off else self.start,
            tuple(_between(self.steps, begin_ns, last_ns)),
            tuple(fix for fix in self.fixes if begin_ns <= fix.stamp_ns and before_end(fix.stamp_ns)),
            (found, *(belief for belief in later if before_end(belief.stamp_ns))),
            end_ns,
        )


def _between(steps: Sequence[OdometryStep], start_ns: int, end_ns: int) -> Iterator[OdometryStep]:
    """Yield the steps from one stamp to another, the first and the last one cut."""
    for step in steps:
        if step.stamp_ns > start_ns and step.start_ns < end_ns:
            yield step.part(max(step.start_ns, start_ns), min(step.stamp_ns, end_ns))
