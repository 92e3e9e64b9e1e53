import math

import numpy as np
import pytest

from localization.localizer import Localizer, LocalizerConfig
from localization.odometry import OdometryStep
from localization.verdicts import Fused, Missed, Refusal, Rejected, Relocalized, Unused
from localization.states import State
from maps.outcomes import Ambiguous, Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2

SECOND_NS = 1_000_000_000
KNOWN = PoseBelief(0, Pose2(1.0, 2.0, 0.5), np.diag([0.0025, 0.0025, 0.0004]))
NOWHERE = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag([math.inf] * 3))


def still(start_s: int, end_s: int) -> OdometryStep:
    return OdometryStep(
        start_s * SECOND_NS, end_s * SECOND_NS, 0.0, 0.0, np.diag([1e-6, 4e-6]) * (end_s - start_s), 1e-6
    )


def seen(stamp_s: float, x: float = 1.0, y: float = 2.0, phi: float = 0.5) -> Fix:
    return Fix(PoseBelief(int(stamp_s * SECOND_NS), Pose2(x, y, phi), np.diag([0.0025, 0.0025, 0.0003])))


def test_verdicts_and_window_growth():
    localizer = Localizer(KNOWN)
    localizer.predict(still(0, 1))
    first = localizer.window_at(SECOND_NS)
    factor = LocalizerConfig().window.growth
    looks = [
        (NoFix(Reason.WEAK_EVIDENCE), Missed(Reason.WEAK_EVIDENCE)),
        (Ambiguous((KNOWN, KNOWN), (0.5, 0.5)), Missed(Unused.AMBIGUOUS)),
    ]
    for misses, (outcome, verdict) in enumerate(looks, start=1):
        assert localizer.fuse(outcome) == verdict
        assert localizer.window_at(SECOND_NS).dt_m == pytest.approx(first.dt_m * factor**misses)
    rejected = localizer.fuse(seen(1.0, x=3.0))
    assert isinstance(rejected, Rejected)
    assert rejected.reason is Refusal.GATE
    assert localizer.window_at(SECOND_NS).dt_m == pytest.approx(first.dt_m * factor**3)
    assert isinstance(localizer.fuse(seen(1.0)), Fused)
    assert localizer.window_at(SECOND_NS).dt_m <= first.dt_m


def test_window_of_a_forgotten_stamp_is_about_the_newest_belief():
    localizer = Localizer(KNOWN)
    for start_s in range(10):
        localizer.predict(still(start_s, start_s + 1))
    assert localizer.belief_at(SECOND_NS) is None
    assert localizer.window_at(SECOND_NS) == localizer.window_at(10 * SECOND_NS)


def test_tracking_becomes_uncertain_without_fixes_and_comes_back():
    localizer = Localizer(KNOWN)
    assert localizer.state is State.TRACKING
    localizer.predict(still(0, 9))
    assert localizer.state is State.TRACKING
    localizer.predict(still(9, 11))
    assert localizer.state is State.UNCERTAIN
    localizer.fuse(seen(11.0))
    assert localizer.state is State.TRACKING


def test_lost_without_a_position():
    localizer = Localizer(NOWHERE)
    localizer.predict(still(0, 1))
    assert localizer.fuse(seen(1.0)) == Missed(Unused.POSITION_UNKNOWN)
    assert localizer.state is State.LOST
    assert localizer.belief is None
    assert localizer.belief_at(0) is None
    assert math.isinf(localizer.window_at(0).dt_m)


def test_reset_begins_again():
    localizer = Localizer(NOWHERE)
    localizer.reset(KNOWN)
    assert localizer.state is State.TRACKING
    assert localizer.belief is not None
    assert localizer.belief.pose == KNOWN.pose


def test_gate_refuses_outliers_and_keeps_good_fixes(simulate):
    refused_good = 0
    for seed in range(5):
        drive = simulate(seed, fix_every=5, outlier_share=0.2)
        localizer, fixes = Localizer(drive.initial), iter(drive.fixes)
        for i, step in enumerate(drive.steps):
            localizer.predict(step)
            if i % 5 == 4:
                fix = next(fixes)
                fused = isinstance(localizer.fuse(Fix(fix)), Fused)
                assert not (fused and fix in drive.outliers)
                refused_good += not fused and fix not in drive.outliers
        assert localizer.belief is not None
        assert drive.nees(localizer.belief) < 16.3  # 99.9 %
    assert refused_good <= 2


def test_perfect_odometry_and_fixes_are_followed_exactly():
    localizer, pose = Localizer(KNOWN), KNOWN.pose
    for i in range(20):
        step = OdometryStep(i * SECOND_NS, (i + 1) * SECOND_NS, 0.3, 0.2, np.diag([1e-4, 1e-4]))
        localizer.predict(step)
        pose = Pose2(pose.x, pose.y, pose.phi) @ Pose2(
            0.3 * math.sin(0.2) / 0.2, 0.3 * (1.0 - math.cos(0.2)) / 0.2, 0.2
        )
        assert isinstance(localizer.fuse(seen(i + 1, pose.x, pose.y, pose.phi)), Fused)
    assert localizer.belief is not None
    assert localizer.belief.pose.minus(pose) == pytest.approx(np.zeros(3), abs=1e-9)


def after_looks(places: list[float]) -> tuple[Localizer, list[object]]:
    """A robot that stands at x = 1 by its odometry, and sees itself at these, one a second."""
    localizer, verdicts = Localizer(KNOWN), []
    for second, x in enumerate(places):
        localizer.predict(still(second, second + 1))
        verdicts.append(localizer.fuse(seen(second + 1.0, x=x)))
    return localizer, verdicts


def test_refused_fixes_that_agree_win():
    localizer, verdicts = after_looks([1.0, 3.0, 3.02, 2.98])
    assert [type(verdict) for verdict in verdicts] == [Fused, Rejected, Rejected, Relocalized]
    assert localizer.belief.pose.x == pytest.approx(3.0, abs=0.05)
    localizer.predict(still(4, 5))
    assert isinstance(localizer.fuse(seen(5.0, x=3.0)), Fused)


@pytest.mark.parametrize(
    "places",
    [
        pytest.param([1.0, 3.0, 5.0, 7.0, -1.0], id="that disagree"),
        pytest.param([1.0, 3.0, 3.0, 1.0, 3.0, 3.0], id="with a good one between"),
    ],
)
def test_refused_fixes_do_not_win(places):
    localizer, verdicts = after_looks(places)
    assert not any(isinstance(verdict, Relocalized) for verdict in verdicts)
    assert localizer.belief.pose.x == pytest.approx(1.0, abs=0.1)


def test_a_refused_position_alone_begins_nothing():
    localizer = Localizer(KNOWN)
    blind = np.diag([0.0025, 0.0025, math.inf])
    for second in range(4):
        localizer.predict(still(second, second + 1))
        fix = Fix(PoseBelief((second + 1) * SECOND_NS, Pose2(3.0, 2.0, 0.0), blind))
        assert isinstance(localizer.fuse(fix), Rejected)
