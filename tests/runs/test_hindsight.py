"""Stretches between carry-offs, and the second look at frames without a fix."""

import math
from pathlib import Path

import numpy as np
import pytest

from localization.odometry import OdometryNoise, OdometryStep, WheelGeometry, advance, wheel_step
from localization.window import WindowConfig
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.config import RunConfig
from runs.hindsight import Account, smoothed_twice
from runs.runlog import NullLog
from runs.runner import run_session
from runs.secondpass import SecondPassConfig, belief_between, second_pass
from runs.session import Frame
from runs.simulation.fixes import FixErrors
from runs.simulation.synthetic import SessionPlan, simulate_session

STEP_NS = 100_000_000
WHEELS = WheelGeometry(0.05, 0.05, 0.3)
#: Where the robot is put, seen from where it was, after ten seconds.
CARRIED = Pose2(3.0, 1.0, 1.5)
CARRIED_NS = 10_050_000_000
STD = np.diag([1e-4, 1e-4, 1e-5])


def carried_off():
    """A drive with a fix every half second; the truth jumps between two odometry stamps."""
    pose = Pose2(1.0, 2.0, 0.3)
    truth, steps, fixes = {0: pose}, [], []
    for i in range(200):
        steps.append(wheel_step(i * STEP_NS, (i + 1) * STEP_NS, 1.0, 1.1, WHEELS, OdometryNoise()))
        if steps[-1].start_ns < CARRIED_NS <= steps[-1].stamp_ns:
            pose = pose @ CARRIED
        pose = advance(pose, steps[-1])
        truth[steps[-1].stamp_ns] = pose
        if i % 5 == 4:
            fixes.append(PoseBelief(steps[-1].stamp_ns, pose, STD))
    return truth, steps, fixes


def account(truth, steps, fixes):
    """What a run writes down that notices after the third fix at the new place."""
    noticed_ns = 11_500_000_000
    published = [
        PoseBelief(ns, truth[ns], STD) for ns in truth if not CARRIED_NS <= ns < noticed_ns and ns > 0
    ]
    fused = [fix.stamp_ns for fix in fixes if not CARRIED_NS <= fix.stamp_ns < noticed_ns]
    found = PoseBelief(noticed_ns, truth[noticed_ns], STD)
    start = PoseBelief(0, truth[0], STD)
    return Account(start, tuple(steps), tuple(fixes), tuple(published), tuple(fused), (found,))


def worst_m(beliefs, truth):
    return max(math.hypot(*belief.pose.minus(truth[belief.stamp_ns])[:2]) for belief in beliefs)


def test_a_carry_off_cuts_the_drive_at_the_first_fix_of_the_new_place():
    truth, steps, fixes = carried_off()
    before, after = account(truth, steps, fixes).stretches()
    assert (before.initial.stamp_ns, before.end_ns) == (0, 10_500_000_000)
    assert (after.initial.stamp_ns, after.end_ns) == (10_500_000_000, None)
    assert max(fix.stamp_ns for fix in before.fixes) == 10_000_000_000
    assert len(before.fixes) + len(after.fixes) == len(fixes)
    assert max(belief.stamp_ns for belief in before.guess) < after.initial.stamp_ns
    assert not after.initial.covariance.max() < 1.0


def test_both_sides_are_smoothed_and_every_stamp_comes_once():
    truth, steps, fixes = carried_off()
    beliefs, again = smoothed_twice(account(truth, steps, fixes), (), None, RunConfig())
    assert [belief.stamp_ns for belief in beliefs] == list(truth)
    known = [belief for belief in beliefs if not 10_000_000_000 < belief.stamp_ns < 10_500_000_000]
    assert worst_m(known, truth) < 0.02
    assert (again.tried, again.fixes) == (0, ())


def test_unbroken_the_jump_is_smeared_or_half_the_fixes_lost():
    truth, steps, fixes = carried_off()
    whole = account(truth, steps, fixes)
    unbroken = Account(whole.start, whole.steps, whole.fixes, whole.published)
    (stretch,) = unbroken.stretches()
    assert worst_m(stretch.smoothed((), RunConfig().smoother), truth) > 0.5


def test_found_for_the_first_time_is_no_carry_off():
    truth, steps, fixes = carried_off()
    start = PoseBelief(500_000_000, truth[500_000_000], STD)
    found = PoseBelief(400_000_000, truth[400_000_000], STD)
    only = Account(start, tuple(steps[5:60]), tuple(fixes[1:10]), (start,), (), (found,))
    (stretch,) = only.stretches()
    assert stretch.initial is start
    assert stretch.end_ns is None


def test_found_with_no_fix_before_it_begins_where_it_was_found():
    truth, steps, fixes = carried_off()
    whole = account(truth, steps, [fix for fix in fixes if not CARRIED_NS < fix.stamp_ns < 11_500_000_000])
    _, after = whole.stretches()
    assert after.initial.stamp_ns == 11_500_000_000


LINE = [
    PoseBelief(i * STEP_NS, Pose2(0.1 * i, 0.0, math.pi - 0.05 + 0.02 * i), STD * (1 + i)) for i in range(6)
]


def frame(stamp_ns):
    return Frame(stamp_ns, stamp_ns, f"{stamp_ns}.jpg", Path(f"{stamp_ns}.jpg"))


def looking(outcomes):
    """A matcher that finds what it is told at each stamp, relative to the window's centre."""
    searched = {}

    def look(image, windows):
        (window,) = windows
        searched[image.stamp_ns] = window
        found = outcomes.get(image.stamp_ns)
        if found is None:
            return NoFix(Reason.WEAK_EVIDENCE)
        centre = window.centre
        return Fix(PoseBelief(image.stamp_ns, Pose2(centre.x + found, centre.y, centre.phi), STD))

    return look, searched


def test_second_pass_searches_small_windows_and_takes_what_fits():
    frames = [frame(ns) for ns in (150_000_000, 250_000_000, 350_000_000)]
    look, searched = looking({150_000_000: 0.01, 250_000_000: 0.3})
    config = SecondPassConfig(doubt=2.0)
    again = second_pass(frames, LINE, look, config, WindowConfig())
    assert (again.tried, len(again.fixes)) == (3, 1)
    assert again.fixes[0].belief.stamp_ns == 150_000_000
    assert again.fixes[0].belief.covariance == pytest.approx(2.0 * STD)
    assert searched[150_000_000].dt_m == WindowConfig().floor_m
    assert searched[150_000_000].centre.x == pytest.approx(0.15)


def test_second_pass_leaves_out_what_is_not_known_well():
    vague = [PoseBelief(b.stamp_ns, b.pose, np.diag([1.0, 1.0, 0.1])) for b in LINE]
    look, searched = looking({})
    stamps = [frame(150_000_000)]
    assert second_pass(stamps, vague, look, SecondPassConfig(), WindowConfig()).tried == 0
    outside = [frame(-1), frame(LINE[-1].stamp_ns + 1)]
    assert second_pass(outside, LINE, look, SecondPassConfig(), WindowConfig()).tried == 0
    assert not searched


def test_belief_between_goes_the_short_way_round():
    between = belief_between(LINE, 250_000_000)
    assert between.pose.x == pytest.approx(0.25)
    assert between.pose.phi == pytest.approx(math.pi)
    assert between.covariance == pytest.approx(3.5 * STD)
    assert belief_between(LINE, 300_000_000) is LINE[3]
    assert belief_between([LINE[0], PoseBelief(10**9, LINE[5].pose, STD)], 5) is None


def test_the_second_pass_counts_in_the_smoothed_track():
    """A fix late in a gap pulls dead reckoning in."""
    truth, steps, fixes = carried_off()
    early = [fix for fix in fixes if fix.stamp_ns < 3_000_000_000]
    crooked = [
        OdometryStep(s.start_ns, s.stamp_ns, s.forward_m, s.turn_rad, s.covariance) for s in steps[:100]
    ]
    start = PoseBelief(0, truth[0], np.diag([1e-4, 1e-4, 1e-4]))
    whole = Account(start, tuple(crooked), tuple(early), ())

    def look(image, _windows):
        return Fix(PoseBelief(image.stamp_ns, truth[image.stamp_ns], STD))

    without, _ = smoothed_twice(whole, (), look, RunConfig())
    beliefs, again = smoothed_twice(whole, (frame(6_000_000_000),), look, RunConfig())
    assert (again.tried, len(again.fixes)) == (1, 1)
    assert beliefs[60].position_std_m < 0.8 * without[60].position_std_m


def test_a_run_has_a_fixed_lag_track_unless_told_otherwise():
    plan = SessionPlan(seconds=15.0, fixes=FixErrors(rate_hz=2.0, delay_s=(0.05, 0.3)))
    session = simulate_session(np.random.default_rng(0), plan).session
    tracks = run_session(session, RunConfig(), NullLog(), lambda *_: None).trajectories
    assert tracks.fixed_lag.stamps_ns.tolist() == tracks.filtered.stamps_ns.tolist()
    off = RunConfig(fixed_lag=type(RunConfig().fixed_lag)(enabled=False))
    tracks = run_session(session, off, NullLog(), lambda *_: None).trajectories
    assert len(tracks.fixed_lag) == 0
    assert "fixed_lag" not in tracks.by_name()
