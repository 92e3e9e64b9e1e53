"""What smoothing costs beside GTSAM's bare Levenberg-Marquardt on the same graph, in one process, CPU time.

`make bench` prints the figures; pytest on this file with `--benchmark-only -s` these alone.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from time import process_time

import gtsam
import numpy as np

from localization.factors import graph_of, motion_covariances, motion_factors, pose_factors
from localization.fixedlag import FixedLagSmoother
from localization.localizer import Localizer
from localization.odometry import OdometryNoise, OdometryStep, WheelGeometry, advance, wheel_step
from localization.smoother import SmootherConfig, huber_optimum, smooth, start_values
from localization.spans import spans_of
from maps.outcomes import Fix, PoseBelief
from maps.poses import Pose2

POSES, EVERY, OUTLIERS = 1000, 10, 0.2
STEP_NS = 250_000_000
WHEELS = WheelGeometry(0.05, 0.05, 0.34)
NOISE, CONFIG = OdometryNoise(), SmootherConfig()
START = PoseBelief(0, Pose2(1.0, 2.0, 0.5), np.diag([1e-4, 1e-4, 1e-4]))


def drive(outliers: float) -> tuple[list[OdometryStep], list[PoseBelief]]:
    """Return 1000 steps and 100 fixes of 5 cm and 1 degree, some of them metres off."""
    rng = np.random.default_rng(0)
    pose, steps, fixes = START.pose, list[OdometryStep](), list[PoseBelief]()
    for i in range(POSES):
        turn = 0.6 * math.sin(i / 23.0)
        step = wheel_step(i * STEP_NS, (i + 1) * STEP_NS, 2.0 - turn, 2.0 + turn, WHEELS, NOISE)
        steps.append(step)
        forward_m, turn_rad = rng.multivariate_normal([step.forward_m, step.turn_rad], step.covariance)
        pose = advance(pose, OdometryStep(step.start_ns, step.stamp_ns, forward_m, turn_rad, step.covariance))
        if i % EVERY == EVERY - 1:
            std = np.array([0.05, 0.05, math.radians(1.0)])
            seen = pose.as_array() + rng.normal(size=3) * std
            if rng.random() < outliers:
                seen += rng.uniform(-2.0, 2.0, 3)
            fixes.append(PoseBelief(step.stamp_ns, Pose2.from_array(seen), np.diag(std**2)))
    return steps, fixes


def fastest_ms(function: Callable[[], object], rounds: int = 7) -> float:
    """The least of several: what disturbs only ever adds."""
    times = []
    gc.disable()
    for _ in range(rounds):
        began = process_time()
        function()
        times.append(process_time() - began)
    gc.enable()
    return min(times) * 1e3


def test_huber_step(benchmark):
    """From spans and fixes to the optimum, the graph's making included."""
    steps, fixes = drive(OUTLIERS)
    spans = spans_of(0, steps, CONFIG.node_spacing_s, (fix.stamp_ns for fix in fixes))
    assert len(spans) == POSES
    keys = {span.end.stamp_ns: key for key, span in enumerate(spans, start=1)}
    looks = [(keys[fix.stamp_ns], fix) for fix in fixes]
    start = start_values(spans, (START,))
    covariances = motion_covariances(spans, CONFIG.slip_share, known=False)
    motions = motion_factors([span.end.pose for span in spans], covariances)
    doubted = [factor for key, fix in looks for factor in pose_factors(key, fix, CONFIG.huber)]
    graph = graph_of([*pose_factors(0, START), *motions, *doubted])
    own = fastest_ms(lambda: huber_optimum(START, spans, looks, start, CONFIG))
    theirs = fastest_ms(lambda: gtsam.LevenbergMarquardtOptimizer(graph, start).optimize())
    whole = fastest_ms(lambda: smooth(START, steps, fixes), 3)
    clean = fastest_ms(lambda: smooth(START, *drive(0.0)), 3)
    print(
        f"\nHuber step {own:.0f} ms, GTSAM's bare Levenberg-Marquardt {theirs:.0f} ms, ratio {own / theirs:.2f}; "
        f"all of smoothing, GNC, systematic errors and covariances included: {whole:.0f} ms, "
        f"without outliers {clean:.0f} ms"
    )
    benchmark.pedantic(lambda: huber_optimum(START, spans, looks, start, CONFIG), rounds=3)
    assert own <= 2.0 * theirs


def test_fixed_lag(benchmark):
    """What the fixed-lag smoother adds to the localizer's work, for each second of driving."""
    steps, fixes = drive(0.0)
    at = {fix.stamp_ns: fix for fix in fixes}

    def run(smoother: FixedLagSmoother | None) -> None:
        localizer = Localizer(START)
        for step in steps:
            localizer.predict(step)
            estimate = localizer.estimate_at(step.stamp_ns)
            if smoother is not None:
                smoother.move(step, estimate)
            fix = at.get(step.stamp_ns)
            if fix is not None:
                localizer.fuse(Fix(fix))
                if smoother is not None:
                    smoother.fuse(fix)

    seconds = POSES * STEP_NS * 1e-9
    alone, both = fastest_ms(lambda: run(None), 3), fastest_ms(lambda: run(FixedLagSmoother()), 3)
    print(f"\nfixed lag: {(both - alone) / seconds:.2f} ms a second of driving")
    benchmark.pedantic(lambda: run(FixedLagSmoother()), rounds=1)
    assert (both - alone) / seconds < 50.0
