"""How fast the filter is, as ratios to filterpy's own predict and update with the same matrices.

`make bench` prints the figures; pytest on this file with `--benchmark-only -s` these alone.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import perf_counter
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
    return min(Timer(function).repeat(9, number)) / number * 1e6


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


def test_late_fix(benchmark):
    """The localizer rewinds a second at 50 Hz: counted in its own predictions."""
    localizer, predicted, fused = Localizer(START), list[float](), list[float]()
    gc.disable()
    for count in range(1, 1001):
        step = step_to(count)
        began = perf_counter()
        localizer.predict(step)
        predicted.append(perf_counter() - began)
        if count > 100 and count % 20 == 0:
            then = localizer.belief_at(step.stamp_ns - 50 * STEP_NS)
            assert then is not None
            fix = Fix(PoseBelief(then.stamp_ns, then.pose, 0.0025 * np.eye(3)))
            began = perf_counter()
            localizer.fuse(fix)
            fused.append(perf_counter() - began)
    gc.enable()
    own, late = np.median(predicted) * 1e6, np.median(fused) * 1e6
    tell(f"localizer's predict {own:.1f} us, fix 1 s late {late:.0f} us, ratio {late / own:.1f}")
    benchmark(lambda: localizer.belief)
    assert late <= 60.0 * own
