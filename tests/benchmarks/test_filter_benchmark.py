"""How fast the filter is, as ratios to filterpy's own predict and update with the same matrices.

Times are the processor's: others may run meanwhile. `make bench` prints the figures; pytest on this file with
`--benchmark-only -s` these alone.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from time import process_time
from timeit import Timer

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from localization.ekf import Estimate, innovation, predict, update
from localization.localizer import Localizer
from localization.motion import moved
from localization.odometry import OdometryNoise, OdometryStep, WheelGeometry, wheel_step
from maps.outcomes import Fix, PoseBelief
from maps.poses import Pose2

STEP_NS = 20_000_000
START = PoseBelief(0, Pose2(1.0, 2.0, 0.5), 0.01 * np.eye(3))
GEOMETRY = WheelGeometry(0.05, 0.05, 0.34)


def step_to(count: int) -> OdometryStep:
    return wheel_step((count - 1) * STEP_NS, count * STEP_NS, 0.10, 0.12, GEOMETRY, OdometryNoise())


def fastest_us(function: Callable[[], object], number: int = 500) -> float:
    """The least mean of several: what disturbs only ever adds."""
    return min(Timer(function, timer=process_time).repeat(9, number)) / number * 1e6


def bare() -> ExtendedKalmanFilter:
    """filterpy's filter with the state and the matrices of one step."""
    estimate, step = Estimate.of(START), step_to(1)
    ekf = ExtendedKalmanFilter(dim_x=7, dim_z=3)
    ekf.x, ekf.P = np.array(estimate.mean), np.array(estimate.joint)
    motion = step.forward_m, step.turn_rad
    _, ekf.F, ekf.Q = moved(estimate.mean, motion, step.systematic, step.random, step.forgetting)
    # Its predict() computes B u too, for nothing.
    ekf.B = 0.0
    return ekf


def bare_update_us() -> float:
    ekf, rows, noise, z = bare(), np.eye(3, 7), 0.0025 * np.eye(3), np.zeros(3)
    return fastest_us(lambda: ekf.update(z, lambda _: rows, lambda x: rows @ x, R=noise))


def tell(*words: str) -> None:
    print("\n", *words)


def test_predict(benchmark):
    estimate, step, ekf = Estimate.of(START), step_to(1), bare()
    predict(estimate, step)
    own, theirs = fastest_us(lambda: predict(estimate, step)), fastest_us(lambda: ekf.predict())
    tell(f"predict {own:.1f} us, filterpy alone {theirs:.1f} us, ratio {own / theirs:.2f}")
    benchmark(predict, estimate, step)
    assert own <= 2.5 * theirs


def test_fix_on_time(benchmark):
    """Innovation, gate and update at the newest odometry's stamp."""
    estimate = predict(Estimate.of(START), step_to(1))
    fix = PoseBelief(STEP_NS, estimate.pose, 0.0025 * np.eye(3))

    def fuse() -> Estimate | None:
        news = innovation(estimate, fix)
        return update(estimate, fix, news) if news.inside(0.999) else None

    own, theirs = fastest_us(fuse), bare_update_us()
    tell(f"fix on time {own:.1f} us, filterpy's update alone {theirs:.1f} us, ratio {own / theirs:.2f}")
    benchmark(fuse)
    assert own <= 4.0 * theirs


STEPS = [step_to(count) for count in range(1, 1001)]


def perfect_fixes(back: int) -> dict[int, Fix]:
    """Return for each step's number the fix that its end would have given `back` steps before."""
    localizer, fixes = Localizer(START), dict[int, Fix]()
    for number, step in enumerate(STEPS):
        localizer.predict(step)
        then = localizer.belief_at(step.stamp_ns - back * STEP_NS)
        if then is not None:
            fixes[number] = Fix(PoseBelief(then.stamp_ns, then.pose, 0.0025 * np.eye(3)))
    return fixes


def driven_us(fixes: Mapping[int, Fix]) -> float:
    """Let a localizer follow all steps and fuse each fix after that of its number; the processor time."""
    localizer = Localizer(START)
    gc.collect()
    gc.disable()
    began = process_time()
    for number, step in enumerate(STEPS):
        localizer.predict(step)
        if number in fixes:
            localizer.fuse(fixes[number])
    spent_us = (process_time() - began) * 1e6
    gc.enable()
    return spent_us


def localizer_us(fixes: Mapping[int, Fix]) -> tuple[float, float]:
    """Return what one of the localizer's predictions takes, and one of its fixes beyond that."""
    plain, fused = (min(driven_us(looks) for _ in range(5)) for looks in ({}, fixes))
    return plain / len(STEPS), (fused - plain) / len(fixes)


def test_the_whole_localizer(benchmark):
    """With several places, weights, trust and the history that a late look may rewind."""
    own, fix = localizer_us(perfect_fixes(0))
    predicted, updated = fastest_us(bare().predict), bare_update_us()
    tell(
        f"localizer's predict {own:.1f} us, {own / predicted:.1f} of filterpy's;",
        f"fix on time {fix:.0f} us, {fix / updated:.1f} of filterpy's updates",
    )
    benchmark(Localizer(START).predict, STEPS[0])
    assert own <= 8.0 * predicted
    assert fix <= 10.0 * updated


def test_late_fix(benchmark):
    """The localizer rewinds a second at 50 Hz: counted in its own predictions."""
    fixes = {number: fix for number, fix in perfect_fixes(50).items() if number % 20 == 0}
    own, late = localizer_us(fixes)
    tell(f"localizer's predict {own:.1f} us, fix 1 s late {late:.0f} us, ratio {late / own:.1f}")
    benchmark(Localizer(START).predict, STEPS[0])
    assert late <= 60.0 * own
