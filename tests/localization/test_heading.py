import math
import time

import numpy as np
import pytest

from localization.localizer import Localizer
from localization.odometry import OdometryStep, advance
from localization.states import State
from localization.verdicts import Fused, Missed, Rejected, Unused
from maps.outcomes import Fix, PoseBelief
from maps.poses import Pose2

SECOND_NS = 1_000_000_000
UNKNOWN = PoseBelief(0, Pose2(1.0, 2.0, 0.0), np.diag([0.0025, 0.0025, math.inf]))


def position(stamp_ns: int, x: float, y: float) -> Fix:
    return Fix(PoseBelief(stamp_ns, Pose2(x, y, 0.0), np.diag([0.0025, 0.0025, math.inf])))


def drive(phi: float, seed: int, outlier: int | None = None, standing_s: int = 0, seconds: int = 12):
    """Drive with position fixes every second; yield (localizer, true pose, newest verdict)."""
    rng = np.random.default_rng(seed)
    localizer, pose = Localizer(UNKNOWN), Pose2(*(np.array([1.0, 2.0]) + rng.normal(size=2) * 0.05), phi)
    for i in range(standing_s + seconds):
        moving = i >= standing_s
        step = OdometryStep(
            i * SECOND_NS,
            (i + 1) * SECOND_NS,
            0.3 if moving else 0.0,
            0.1 if moving else 0.0,
            np.diag([1e-4, 1e-4]),
        )
        pose = advance(pose, step)
        localizer.predict(step)
        off = np.array([1.0, -1.5]) if i == outlier else rng.normal(size=2) * 0.05
        yield localizer, pose, localizer.fuse(position(step.stamp_ns, pose.x + off[0], pose.y + off[1]))


@pytest.mark.parametrize("phi", [0.0, 1.5, 3.1, -3.1, -0.7])
@pytest.mark.parametrize("outlier", [None, 0, 2, 5])
def test_heading_is_found_from_positions(phi, outlier):
    for localizer, pose, verdict in drive(phi, seed=1, outlier=outlier):
        belief = localizer.belief
        if belief is None:
            assert verdict == Missed(Unused.HEADING_UNKNOWN)
            assert localizer.state is State.LOST
        else:
            error = belief.pose.minus(pose)
            assert error @ np.linalg.solve(belief.covariance, error) < 21.1  # 99.99 %
    assert localizer.belief is not None
    assert abs(error[2]) < math.radians(5.0)


def test_found_headings_are_honest():
    """At the moment of the start, over many drives: the error is what the belief says."""
    ratios = []
    for seed in range(30):
        phi = math.remainder(0.7 * seed, 2.0 * math.pi)
        for localizer, pose, verdict in drive(phi, seed):
            if isinstance(verdict, Fused) and localizer.belief is not None:
                error = localizer.belief.pose.minus(pose)[2]
                ratios.append(error / localizer.belief.heading_std_rad)
                break
    assert len(ratios) == 30
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_standing_tells_nothing():
    for localizer, _, verdict in drive(1.0, seed=3, standing_s=20, seconds=0):
        assert verdict == Missed(Unused.HEADING_UNKNOWN)
        assert localizer.belief is None


def test_one_fix_far_away_does_not_decide():
    localizer = Localizer(UNKNOWN)
    localizer.predict(OdometryStep(0, SECOND_NS, 1.0, 0.0, np.diag([1e-4, 1e-4])))
    assert localizer.fuse(position(SECOND_NS, 1.0, 3.0)) == Missed(Unused.HEADING_UNKNOWN)
    (window,) = localizer.windows_at(SECOND_NS)
    assert 1.0 < window.dt_m < 1.5
    assert window.dphi_rad == math.pi


def test_a_fix_with_heading_starts_at_once():
    localizer = Localizer(UNKNOWN)
    localizer.predict(OdometryStep(0, SECOND_NS, 1.0, 0.5, np.diag([1e-4, 1e-4])))
    end = advance(Pose2(1.0, 2.0, 2.0), OdometryStep(0, SECOND_NS, 1.0, 0.5, np.eye(2)))
    wrong = PoseBelief(SECOND_NS, Pose2(end.x + 2.0, end.y, end.phi), np.diag([0.0025, 0.0025, 0.0004]))
    assert localizer.fuse(Fix(wrong)) == Missed(Unused.HEADING_UNKNOWN)
    right = PoseBelief(SECOND_NS, end, np.diag([0.0025, 0.0025, 0.0004]))
    assert isinstance(localizer.fuse(Fix(right)), Fused)
    assert localizer.belief is not None
    assert localizer.belief.pose.minus(end) == pytest.approx(np.zeros(3), abs=0.05)


def test_late_fixes_before_the_start_count_too():
    looks = list(range(1, 9))
    found = []
    for order in (looks, [1, 3, 2, 5, 4, 7, 6, 8]):
        localizer, pose = Localizer(UNKNOWN), Pose2(1.0, 2.0, -2.0)
        fixes = {}
        for i in looks:
            step = OdometryStep((i - 1) * SECOND_NS, i * SECOND_NS, 0.2, 0.05, np.diag([1e-4, 1e-4]))
            pose = advance(pose, step)
            localizer.predict(step)
            fixes[i] = position(step.stamp_ns, pose.x, pose.y)
        for i in order:
            verdict = localizer.fuse(fixes[i])
            if localizer.belief is not None:
                break
        assert not isinstance(verdict, Rejected)
        assert localizer.belief is not None
        found.append(localizer.belief.pose.minus(pose))
    assert np.abs(found).max() < 0.05


def test_a_minute_of_standing_at_50_hz_is_not_slow():
    localizer, began = Localizer(UNKNOWN), time.perf_counter()
    for i in range(3000):
        localizer.predict(
            OdometryStep(i * 20_000_000, (i + 1) * 20_000_000, 0.0, 0.0, 1e-7 * np.eye(2), 1e-8)
        )
        if i % 10 == 9:
            localizer.fuse(position((i + 1) * 20_000_000, 1.0, 2.0))
    assert time.perf_counter() - began < 5.0


def test_a_vague_start_is_learned_while_standing():
    vague = PoseBelief(0, Pose2(1.0, 2.0, 0.0), np.diag([1.0, 1.0, math.inf]))
    localizer, pose = Localizer(vague), Pose2(1.9, 1.2, 0.6)
    for i in range(16):
        forward_m = 0.3 if i >= 8 else 0.0
        step = OdometryStep(i * SECOND_NS, (i + 1) * SECOND_NS, forward_m, 0.0, 1e-4 * np.eye(2))
        pose = advance(pose, step)
        localizer.predict(step)
        localizer.fuse(position(step.stamp_ns, pose.x, pose.y))
        if localizer.belief is not None:
            assert abs(localizer.belief.pose.minus(pose)[2]) < math.radians(2.0)
    assert localizer.belief is not None
