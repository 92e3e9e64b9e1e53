import math

import numpy as np
import pytest

from localization.localizer import Localizer, LocalizerConfig
from localization.odometry import OdometryStep, advance
from localization.states import Doubt, State
from localization.verdicts import Fused, Missed, Refusal, Rejected, Relocalized, Unused
from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason, SearchWindow
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
    (first,) = localizer.windows_at(SECOND_NS)
    factor = LocalizerConfig().window.growth
    elsewhere = Ambiguous((seen(1.0, x=8.0).belief, seen(1.0, y=-5.0).belief), (0.5, 0.5))
    looks = [
        (NoFix(Reason.WEAK_EVIDENCE), Missed(Reason.WEAK_EVIDENCE)),
        (elsewhere, Missed(Unused.AMBIGUOUS)),
    ]
    for misses, (outcome, verdict) in enumerate(looks, start=1):
        assert localizer.fuse(outcome) == verdict
        assert localizer.windows_at(SECOND_NS)[0].dt_m == pytest.approx(first.dt_m * factor**misses)
    localizer.predict(still(1, 2))
    rejected = localizer.fuse(seen(2.0, x=3.0))
    assert isinstance(rejected, Rejected)
    assert rejected.reason is Refusal.GATE
    assert rejected.nis == pytest.approx(2.0**2 / 0.005, rel=0.01)
    assert isinstance(localizer.fuse(seen(1.5)), Fused)
    localizer.predict(still(2, 3))
    assert isinstance(localizer.fuse(seen(3.0)), Fused)
    assert localizer.windows_at(3 * SECOND_NS)[0].dt_m <= first.dt_m


def test_what_a_slip_may_have_done_has_a_window_until_a_fix_settles_it():
    localizer = Localizer(KNOWN)
    assert localizer.slip_windows_at(0) == ()
    rolled = OdometryStep(0, SECOND_NS, 1.0, 0.0, np.diag([1e-3, 1e-3]), slip=10.0)
    localizer.predict(rolled)
    (usual,), (slipped,) = localizer.windows_at(SECOND_NS), localizer.slip_windows_at(SECOND_NS)
    assert slipped.centre == usual.centre
    # Three quarters of what chi-square grants at 99.9 %: 99 % will do for what is rare itself.
    wider = (0.0004 + 1e-3 + 0.61 * 10.0 * 1e-3) / (0.0004 + 1e-3)
    assert slipped.dphi_rad == pytest.approx(usual.dphi_rad * math.sqrt(wider), rel=0.01)
    assert slipped.dt_m > 1.5 * usual.dt_m
    localizer.fuse(seen(1.0, x=1.0 + math.cos(0.5), y=2.0 + math.sin(0.5)))
    assert localizer.slip_windows_at(SECOND_NS) == ()
    assert Localizer(None).slip_windows_at(SECOND_NS) == ()


def test_three_looks_on_end_that_fit_nothing_are_searched_everywhere():
    """Where the map shows nothing, nothing can be missing: the place stays likely, and may be wrong."""
    localizer = Localizer(KNOWN)
    for second in (1, 2, 3):
        assert len(localizer.windows_at(second * SECOND_NS)) == 1
        localizer.predict(still(second - 1, second))
        localizer.fuse(NoFix(Reason.NOTHING_VISIBLE))
    assert localizer.windows_at(3 * SECOND_NS)[-1] == SearchWindow.everywhere()
    assert localizer.belief is not None


def test_window_of_a_forgotten_stamp_is_about_the_newest_belief():
    localizer = Localizer(KNOWN)
    for start_s in range(10):
        localizer.predict(still(start_s, start_s + 1))
    assert localizer.belief_at(SECOND_NS) is None
    assert localizer.windows_at(SECOND_NS) == localizer.windows_at(10 * SECOND_NS)


def test_tracking_becomes_uncertain_without_fixes_and_comes_back():
    localizer = Localizer(KNOWN)
    assert localizer.state is State.TRACKING
    localizer.predict(still(0, 9))
    assert localizer.state is State.TRACKING
    localizer.predict(still(9, 11))
    assert localizer.state is State.UNCERTAIN
    localizer.fuse(seen(11.0))
    assert localizer.state is State.TRACKING


def turning(start_s: int) -> OdometryStep:
    return OdometryStep(start_s * SECOND_NS, (start_s + 1) * SECOND_NS, 0.3, 0.2, np.diag([1e-4, 1e-4]))


@pytest.mark.parametrize("initial", [None, NOWHERE])
def test_a_lost_robot_trusts_a_place_that_a_second_look_confirms(initial):
    localizer = Localizer(initial)
    localizer.predict(still(0, 1))
    assert localizer.state is State.LOST
    assert localizer.windows_at(SECOND_NS) == (SearchWindow.everywhere(),)
    assert localizer.fuse(seen(1.0)) == Missed(Unused.UNCONFIRMED)
    assert (localizer.belief, localizer.belief_at(SECOND_NS), localizer.map_from_odom) == (None, None, None)
    localizer.predict(turning(1))
    end = advance(KNOWN.pose, turning(1))
    assert isinstance(localizer.fuse(seen(2.0, end.x, end.y, end.phi)), Relocalized)
    assert localizer.state is State.TRACKING
    assert localizer.belief.pose.minus(end) == pytest.approx(np.zeros(3), abs=1e-6)


def test_a_lost_robot_does_not_trust_looks_that_disagree_with_odometry():
    localizer = Localizer()
    for second in range(5):
        # Its looks say that it stands, its wheels that it turns.
        localizer.predict(turning(second))
        assert localizer.fuse(seen(second + 1.0)) == Missed(Unused.UNCONFIRMED)
    assert localizer.state is State.LOST


def test_one_look_taken_twice_confirms_nothing():
    localizer = Localizer()
    localizer.predict(still(0, 1))
    for stamp_s in (1.0, 1.001, 1.002):
        localizer.fuse(seen(stamp_s))
    assert localizer.state is State.LOST


def test_several_places_are_kept_until_a_look_tells_them_apart():
    """Two rooms alike: five looks that fit both, then one that fits the second."""
    localizer, here, there = Localizer(), KNOWN.pose, Pose2(6.0, 2.0, 0.5)
    for second in range(5):
        localizer.predict(turning(second))
        here, there = advance(here, turning(second)), advance(there, turning(second))
        places = (seen(second + 1.0, *here.as_array()), seen(second + 1.0, *there.as_array()))
        verdict = localizer.fuse(Ambiguous(tuple(place.belief for place in places), (0.6, 0.4)))
        assert verdict == Missed(Unused.AMBIGUOUS)
    assert localizer.state is State.LOST
    assert len(localizer.beliefs) == 2
    assert [window.dt_m for window in localizer.windows_at(5 * SECOND_NS)][-1] == math.inf
    for second in (5, 6):
        localizer.predict(turning(second))
        there = advance(there, turning(second))
        localizer.fuse(seen(second + 1.0, *there.as_array()))
    assert localizer.state is State.TRACKING
    assert localizer.belief.pose.minus(there) == pytest.approx(np.zeros(3), abs=0.05)


def test_a_tracking_robot_knows_which_of_two_places_it_sees():
    localizer = Localizer(KNOWN)
    localizer.predict(still(0, 1))
    far = seen(1.0, x=8.0).belief
    assert isinstance(localizer.fuse(Ambiguous((far, seen(1.0).belief), (0.6, 0.4))), Fused)
    assert localizer.state is State.TRACKING
    assert localizer.belief.pose.x == pytest.approx(1.0, abs=1e-6)


def test_two_places_that_both_fit_are_uncertain():
    vague = PoseBelief(0, KNOWN.pose, np.diag([0.02, 0.02, 0.001]))
    localizer = Localizer(vague)
    localizer.predict(still(0, 1))
    places = tuple(seen(1.0, x=1.0 + side).belief for side in (-0.25, 0.25))
    assert isinstance(localizer.fuse(Ambiguous(places, (0.5, 0.5))), Fused)
    assert localizer.state is State.UNCERTAIN
    assert Doubt.CONTRADICTED in localizer.diagnosis.doubts
    assert len(localizer.beliefs) == 2


def nothing(stamp_s: float) -> tuple[NoFix, None, int]:
    """An image that shows none of the twenty edges that should be seen."""
    look = Look(lines_px=np.zeros((50, 2, 2)), predicted_px=np.zeros((20, 2, 2)))
    return NoFix(Reason.WEAK_EVIDENCE, look), None, int(stamp_s * SECOND_NS)


def test_a_robot_carried_between_look_alikes_is_lost_until_one_is_left():
    """The odds of one image are those of the next: they do not add up, and neither place is published."""
    localizer = Localizer(KNOWN)
    for second in range(1, 7):
        localizer.predict(still(second - 1, second))
        places = seen(second, x=8.0).belief, seen(second, y=-5.0).belief
        localizer.fuse(Ambiguous(places, (0.7, 0.3)))
        assert localizer.belief is None or localizer.belief.pose.x == pytest.approx(1.0)
    assert localizer.state is State.LOST
    (_, one), (_, other) = localizer.beliefs[:2]
    assert one == pytest.approx(other, rel=0.01)
    localizer.predict(still(6, 8))
    assert isinstance(localizer.fuse(seen(7.0, y=-5.0)), Relocalized)
    assert localizer.belief.pose.y == pytest.approx(-5.0, abs=0.01)


def test_three_images_that_show_nothing_expected_are_doubted_and_a_fix_settles_it():
    localizer = Localizer(KNOWN)
    for second in range(3):
        assert localizer.state is State.TRACKING
        localizer.predict(still(second, second + 1))
        localizer.fuse(*nothing(second + 1.0))
    assert localizer.diagnosis.state is State.UNCERTAIN
    assert {Doubt.CONTRADICTED, Doubt.UNEXPLAINED} <= set(localizer.diagnosis.doubts)
    assert localizer.windows_at(3 * SECOND_NS)[-1] == SearchWindow.everywhere()
    assert localizer.belief is not None
    localizer.predict(still(3, 4))
    localizer.fuse(seen(4.0))
    assert localizer.state is State.TRACKING


def test_a_covered_camera_contradicts_nothing():
    localizer = Localizer(KNOWN)
    for second in range(9):
        localizer.predict(still(second, second + 1))
        localizer.fuse(NoFix(Reason.TOO_FEW_SEGMENTS), None, (second + 1) * SECOND_NS)
    assert localizer.state is State.TRACKING
    for second in range(9, 12):
        localizer.predict(still(second, second + 1))
    assert localizer.diagnosis.doubts == (Doubt.NO_UPDATE,)


def test_a_pose_that_many_images_contradict_is_lost_and_comes_back_only_confirmed():
    localizer = Localizer(KNOWN)
    for second in range(8):
        localizer.predict(still(second, second + 1))
        localizer.fuse(*nothing(second + 1.0))
    assert localizer.state is State.LOST
    assert localizer.belief is None
    # Two looks that agree are not enough where eight found nothing.
    for second in range(8, 12):
        assert localizer.state is State.LOST
        localizer.predict(still(second, second + 1))
        localizer.fuse(seen(second + 1.0))
    assert localizer.state is State.TRACKING


@pytest.mark.parametrize("shown", [0, 4])
def test_a_place_that_few_looks_have_shown_is_given_up_soon(shown):
    """Whatever the reason: of another building's map nobody can say what should be seen."""
    localizer = Localizer(KNOWN)
    for second in range(shown):
        localizer.predict(still(second, second + 1))
        localizer.fuse(seen(second + 1.0))
    for second in range(shown, 2 * shown + 6):
        localizer.predict(still(second, second + 1))
        localizer.fuse(NoFix(Reason.NOTHING_VISIBLE))
        assert localizer.state is not State.LOST
    localizer.predict(still(2 * shown + 6, 2 * shown + 7))
    localizer.fuse(NoFix(Reason.NOTHING_VISIBLE))
    assert localizer.state is State.LOST
    assert localizer.belief is None
    assert localizer.diagnosis.places == 0


def given_up(shown: int) -> tuple[Localizer, int]:
    """Return a localizer that has seen its place so often, and then nothing until it gave it up; and when."""
    localizer, second = Localizer(KNOWN), 0
    while localizer.state is not State.LOST:
        localizer.predict(still(second, second + 1))
        second += 1
        outcome = seen(second) if second <= shown else NoFix(Reason.WEAK_EVIDENCE)
        localizer.fuse(outcome, SearchWindow.everywhere())
    return localizer, second


def test_a_place_that_was_given_up_is_believed_again_when_a_look_shows_it():
    """Half a picture was covered for long. Where odometry has led meanwhile no look shows by chance."""
    localizer, second = given_up(8)
    assert localizer.belief is None
    near, everywhere = localizer.windows_at(second * SECOND_NS)
    assert near.dt_m < 1.0
    assert everywhere == SearchWindow.everywhere()
    driven = OdometryStep(second * SECOND_NS, (second + 1) * SECOND_NS, 0.5, 0.0, np.diag([1e-4, 1e-4]))
    localizer.predict(driven)
    there = advance(KNOWN.pose, driven)
    assert isinstance(localizer.fuse(seen(second + 1.0, there.x, there.y)), Relocalized)
    assert localizer.state is State.TRACKING


def test_what_is_shown_elsewhere_than_at_a_place_given_up_must_be_shown_as_often_as_ever():
    localizer, second = given_up(8)
    agreed = 0
    while localizer.state is State.LOST:
        localizer.predict(still(second, second + 1))
        second += 1
        localizer.fuse(seen(second, x=5.0))
        agreed += 1
    assert agreed > 2
    # It is the only place by now.
    assert localizer.diagnosis.places == 1


def test_fixes_that_keep_pulling_strain_the_belief_until_others_fit_better():
    """Wheels have slipped, and near where they say the robot is the lines happen to fit."""
    localizer = Localizer(KNOWN)
    for second in range(20):
        localizer.predict(still(second, second + 1))
        localizer.fuse(seen(second + 1.0, x=1.0 + 0.02 * (-1.0) ** second))
    assert localizer.state is State.TRACKING
    (narrow,) = localizer.windows_at(20 * SECOND_NS)
    second = 20
    while localizer.state is State.TRACKING:
        localizer.predict(still(second, second + 1))
        localizer.fuse(seen(second + 1.0, x=1.15 if second % 2 else 0.8))
        second += 1
    assert second in (22, 23)
    assert Doubt.STRAINED in localizer.diagnosis.doubts
    about, aside = localizer.windows_at(second * SECOND_NS)
    assert about.dt_m < 2.0 * narrow.dt_m
    assert (aside.centre, aside.dt_m) == (about.centre, LocalizerConfig().window.aside_m)
    # What was slipped to wins with the second look.
    for verdict in (Rejected, Relocalized):
        localizer.predict(still(second, second + 1))
        second += 1
        assert isinstance(localizer.fuse(seen(second, x=1.6)), verdict)
    assert localizer.state is State.TRACKING
    assert localizer.belief.pose.x == pytest.approx(1.6, abs=0.05)


@pytest.mark.parametrize(("x", "strained"), [(1.25, True), (1.5, False)])
def test_outliers_pull_only_beside_the_place(x, strained):
    """A slip leads near; far away something always fits."""
    localizer = Localizer(PoseBelief(0, KNOWN.pose, 1e-6 * np.eye(3)))
    for second in range(2):
        localizer.predict(still(second, second + 1))
        fix = PoseBelief((second + 1) * SECOND_NS, Pose2(x, 2.0, 0.5), 1e-4 * np.eye(3))
        verdict = localizer.fuse(Fix(fix))
        assert isinstance(verdict, Rejected)
        assert verdict.nis > 100.0
    assert (Doubt.STRAINED in localizer.diagnosis.doubts) == strained


def test_a_search_farther_off_that_finds_the_same_place_ends_the_strain():
    localizer, second = Localizer(KNOWN), 0
    while localizer.state is State.TRACKING:
        localizer.predict(still(second, second + 1))
        localizer.fuse(seen(second + 1.0, x=(0.8, 1.15)[second % 2]))
        second += 1
    localizer.predict(still(second, second + 1))
    assert isinstance(localizer.fuse(seen(second + 1.0)), Fused)
    assert localizer.state is State.TRACKING
    assert len(localizer.windows_at((second + 1) * SECOND_NS)) == 1


def test_a_covered_camera_gives_no_place_up():
    localizer = Localizer(KNOWN)
    for second in range(30):
        localizer.predict(still(second, second + 1))
        localizer.fuse(NoFix(Reason.TOO_FEW_SEGMENTS))
    assert localizer.belief is not None


@pytest.mark.parametrize(("found_nothing", "needed"), [(0, 2), (4, 2), (5, 3), (100, 6)])
def test_where_most_looks_find_nothing_more_must_agree(found_nothing, needed):
    """None has shown yet that the map is of this building."""
    localizer = Localizer()
    for second in range(found_nothing):
        localizer.predict(still(second, second + 1))
        localizer.fuse(NoFix(Reason.WEAK_EVIDENCE), SearchWindow.everywhere())
    assert agreeing(localizer, found_nothing) == needed


@pytest.mark.parametrize(("shown", "vainly", "needed"), [(2, 0, 3), (8, 0, 2), (8, 3, 2), (8, 20, 6)])
def test_who_has_been_tracked_is_sooner_found_elsewhere(shown, vainly, needed):
    """Looks have shown that the map is of this building, until too many in turn show nothing of it."""
    localizer, second = Localizer(KNOWN), shown
    for early in range(shown):
        localizer.predict(still(early, early + 1))
        localizer.fuse(seen(early + 1.0))
    expected = Look(predicted_px=np.zeros((20, 2, 2)))
    while localizer.state is not State.LOST:
        localizer.predict(still(second, second + 1))
        localizer.fuse(NoFix(Reason.WEAK_EVIDENCE, expected), SearchWindow(KNOWN.pose, 0.3, 0.1))
        second += 1
    for later in range(second, second + vainly):
        localizer.predict(still(later, later + 1))
        localizer.fuse(NoFix(Reason.WEAK_EVIDENCE), SearchWindow.everywhere())
    assert agreeing(localizer, second + vainly) == needed


def agreeing(localizer: Localizer, second: int) -> int:
    """Return how many looks at a place, one a second, it takes until the robot is believed to be there."""
    agreed = 0
    while localizer.state is State.LOST:
        localizer.predict(still(second, second + 1))
        second += 1
        localizer.fuse(seen(float(second), x=5.0))
        agreed += 1
    return agreed


def test_position_only_fixes_bring_back_a_robot_that_knew_nothing():
    localizer, pose = Localizer(), Pose2(1.0, 2.0, -2.0)
    for second in range(12):
        localizer.predict(turning(second))
        pose = advance(pose, turning(second))
        covariance = np.diag([0.0025, 0.0025, math.inf])
        localizer.fuse(Fix(PoseBelief((second + 1) * SECOND_NS, Pose2(pose.x, pose.y, 0.0), covariance)))
    assert localizer.belief is not None
    assert localizer.belief.pose.minus(pose) == pytest.approx(np.zeros(3), abs=0.1)


def test_odometry_frame_never_jumps_and_the_correction_does():
    localizer, moved = Localizer(KNOWN), Pose2(0.0, 0.0, 0.0)
    for second in range(6):
        localizer.predict(turning(second))
        moved = advance(moved, turning(second))
        if second == 3:
            localizer.reset(PoseBelief(4 * SECOND_NS, Pose2(7.0, 7.0, 1.0), KNOWN.covariance))
        assert localizer.odom_from_robot.minus(moved) == pytest.approx(np.zeros(3), abs=1e-12)
        there = localizer.map_from_odom @ localizer.odom_from_robot
        assert there.minus(localizer.belief.pose) == pytest.approx(np.zeros(3), abs=1e-9)
        jumped = abs(localizer.belief.pose.x - 1.0) > 4.0
        assert jumped == (second >= 3)


def test_reset_begins_again_and_keeps_the_odometry_since():
    localizer = Localizer(NOWHERE)
    localizer.reset(KNOWN)
    assert localizer.state is State.TRACKING
    assert localizer.belief.pose == KNOWN.pose
    for second in range(2):
        localizer.predict(turning(second))
    localizer.reset(PoseBelief(SECOND_NS, KNOWN.pose, KNOWN.covariance))
    assert localizer.belief.stamp_ns == 2 * SECOND_NS
    assert localizer.belief.pose == advance(KNOWN.pose, turning(1))
    localizer.reset(None)
    assert localizer.state is State.LOST


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


def test_refused_positions_alone_win_nothing_but_doubt():
    localizer = Localizer(KNOWN)
    blind = np.diag([0.0025, 0.0025, math.inf])
    states = [*2 * [State.TRACKING], *4 * [State.UNCERTAIN], State.LOST]
    for second, state in enumerate(states):
        localizer.predict(still(second, second + 1))
        fix = Fix(PoseBelief((second + 1) * SECOND_NS, Pose2(3.0, 2.0, 0.0), blind))
        verdict = localizer.fuse(fix)
        assert isinstance(verdict, Missed if state is State.LOST else Rejected)
        assert localizer.state is state
