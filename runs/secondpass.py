"""A second look at the frames without a fix: where the robot was is known better by then."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from localization.ekf import Estimate, innovation
from localization.window import WindowConfig, window_about
from maps.outcomes import Fix, Outcome, PoseBelief
from maps.poses import Pose2
from runs.looking import Windows
from runs.session import Frame

#: Matches a frame inside windows.
Look = Callable[[Frame, Windows], Outcome]

#: Beliefs further apart do not tell of what lies between them.
_NEIGHBOURS_NS = 500_000_000


@dataclass(frozen=True, slots=True)
class SecondPassConfig:
    """Which frames are matched again, and what of it is taken.

    `enabled`: whether any are. `largest_m`, `largest_rad`: windows no wider than these; a wider one is a search
    anew, which had its chance. `gate`: probability that a good fix is as near the smoothed pose as it must be.
    `doubt`: variances are so many times what the matcher says. Images that showed nothing at first are the hard
    ones: what comes of them was found to have 2.3 times the squared error that it states.
    """

    enabled: bool = True
    largest_m: float = 0.5
    largest_rad: float = 0.2
    gate: float = 0.95
    doubt: float = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class SecondPass:
    """What it brought: frames that were matched again, and the fixes found, as uncertain as they are taken to be."""

    tried: int = 0
    fixes: tuple[Fix, ...] = ()

    def and_then(self, later: SecondPass) -> SecondPass:
        """Return what this one and a later one brought."""
        return SecondPass(self.tried + later.tried, self.fixes + later.fixes)


def second_pass(
    frames: Sequence[Frame],
    smoothed: Sequence[PoseBelief],
    look: Look,
    config: SecondPassConfig,
    window: WindowConfig,
) -> SecondPass:
    """Match frames inside the windows about the smoothed beliefs, which are in order of time."""
    tried, found = 0, list[Fix]()
    for frame in frames:
        expected = belief_between(smoothed, frame.stamp_ns)
        if expected is None:
            continue
        small = window_about(expected, 0, window)
        if small.dt_m > config.largest_m or small.dphi_rad > config.largest_rad:
            continue
        tried += 1
        outcome = look(frame, (small,))
        if isinstance(outcome, Fix) and _fits(expected, outcome, config):
            belief = outcome.belief
            doubted = PoseBelief(belief.stamp_ns, belief.pose, config.doubt * belief.covariance)
            found.append(Fix(doubted))
    return SecondPass(tried, tuple(found))


def belief_between(beliefs: Sequence[PoseBelief], stamp_ns: int) -> PoseBelief | None:
    """Return the belief at a stamp, linear between its neighbours; None outside, and where they are far apart."""
    after = bisect_left(beliefs, stamp_ns, key=lambda belief: belief.stamp_ns)
    if after == len(beliefs):
        return None
    second = beliefs[after]
    if second.stamp_ns == stamp_ns:
        return second
    if after == 0 or second.stamp_ns - beliefs[after - 1].stamp_ns > _NEIGHBOURS_NS:
        return None
    first = beliefs[after - 1]
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    pose = Pose2.from_array(first.pose.as_array() + share * second.pose.minus(first.pose))
    return PoseBelief(stamp_ns, pose, (1.0 - share) * first.covariance + share * second.covariance)


def _fits(expected: PoseBelief, fix: Fix, config: SecondPassConfig) -> bool:
    return innovation(Estimate.of(expected), fix.belief).inside(config.gate)
