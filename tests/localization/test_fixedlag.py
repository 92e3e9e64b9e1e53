import math
from dataclasses import replace

import numpy as np
import pytest

from localization.fixedlag import FixedLagConfig, FixedLagSmoother
from localization.localizer import Localizer
from localization.smoother import smooth
from localization.verdicts import Fused
from maps.outcomes import Fix


def lagged(drive, config=None, late_ns=0):
    """Run localizer and fixed-lag smoother side by side: what they told, filtered and with the lag."""
    localizer, smoother = Localizer(drive.initial), FixedLagSmoother(config)
    waiting, filtered, told = list(drive.fixes), [], []
    for step in drive.steps:
        localizer.predict(step)
        estimate = localizer.estimate_at(step.stamp_ns)
        filtered.append(estimate.belief)
        told += smoother.move(step, estimate)
        while waiting and waiting[0].stamp_ns + late_ns <= step.stamp_ns:
            fix = waiting.pop(0)
            if isinstance(localizer.fuse(Fix(fix)), Fused):
                smoother.fuse(fix)
    return filtered, told, smoother


def test_between_filter_and_batch(simulate):
    errors = []
    for seed in range(6):
        drive = simulate(seed, steps=300)
        filtered, told, smoother = lagged(drive)
        batch = smooth(drive.initial, drive.steps, drive.fixes).beliefs
        errors.append([drive.error(beliefs) for beliefs in (filtered, [*told, *smoother.rest()], batch)])
    before, lag, after = np.mean(errors, axis=0)
    assert after < lag < 0.9 * before


def test_every_step_is_told_once_and_in_order_a_lag_later(simulate):
    drive = simulate(0)
    _, told, smoother = lagged(drive)
    lag_ns = drive.steps[-1].stamp_ns - told[-1].stamp_ns
    assert 5e9 <= lag_ns < 5.6e9
    stamps = [belief.stamp_ns for belief in [*told, *smoother.rest()]]
    assert stamps == [step.stamp_ns for step in drive.steps]
    assert smoother.rest() == []


def test_honest(simulate):
    drives = [simulate(seed) for seed in range(12)]
    nees = [drive.nees(lagged(drive)[1][100]) for drive in drives]
    assert 0.5 < np.mean(nees) / 3 < 1.8


def test_late_fixes_count_at_their_own_stamp(simulate):
    on_time, late = [], []
    for seed in range(3):
        drive = simulate(seed)
        on_time.append(drive.error(lagged(drive)[1]))
        late.append(drive.error(lagged(drive, late_ns=600_000_000)[1]))
    assert np.mean(late) == pytest.approx(np.mean(on_time), rel=0.15)


def test_position_only_fixes_and_a_shorter_lag(simulate):
    drive = simulate(1, fix_stds=(0.05, 0.05, math.inf))
    filtered, told, _ = lagged(drive, FixedLagConfig(lag_s=2.0))
    assert drive.steps[-1].stamp_ns - told[-1].stamp_ns < 2.6e9
    assert drive.error(told) < drive.error(filtered)


def test_fixes_older_than_the_window_are_left_out(simulate):
    drive = simulate(0)
    _, told, smoother = lagged(drive, FixedLagConfig(lag_s=1.0))
    smoother.fuse(drive.outliers[0] if drive.outliers else drive.fixes[0])
    rest = smoother.rest()
    assert drive.error([*told, *rest]) < 0.5


def test_lost_and_found_again_begins_anew(simulate):
    drive = simulate(0)
    localizer, smoother, told = Localizer(drive.initial), FixedLagSmoother(), []
    for i, step in enumerate(drive.steps):
        localizer.predict(step)
        lost = 80 <= i < 100
        told += smoother.move(step, None if lost else localizer.estimate_at(step.stamp_ns))
    told += smoother.rest()
    kept = [step.stamp_ns for i, step in enumerate(drive.steps) if not 80 <= i < 100]
    assert [belief.stamp_ns for belief in told] == kept


def test_a_hole_in_the_odometry_longer_than_the_window(simulate):
    drive = simulate(0)
    jump_ns = 20_000_000_000
    steps = [
        step if i < 100 else replace(step, start_ns=step.start_ns + jump_ns, stamp_ns=step.stamp_ns + jump_ns)
        for i, step in enumerate(drive.steps)
    ]
    localizer, smoother, told = Localizer(drive.initial), FixedLagSmoother(), []
    for step in steps:
        localizer.predict(step)
        told += smoother.move(step, localizer.estimate_at(step.stamp_ns))
    stamps = [belief.stamp_ns for belief in [*told, *smoother.rest()]]
    assert stamps == sorted(stamps)
    assert set(stamps) >= {step.stamp_ns for step in steps[:100]}
