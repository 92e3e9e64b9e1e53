"""Drives simulated with the model's own noise: what the filter assumes is then exactly true."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from localization.odometry import OdometryNoise, OdometryStep, WheelGeometry, advance, wheel_step
from maps.outcomes import PoseBelief
from maps.poses import Pose2

STEP_NS = 100_000_000
GEOMETRY = WheelGeometry(0.05, 0.05, 0.3)
#: Worse than the default, so that a short drive drifts visibly.
NOISE = OdometryNoise(wheel_m2_per_m=5e-4, sideways_share=0.5)


@dataclass(frozen=True)
class Drive:
    initial: PoseBelief
    steps: list[OdometryStep]
    truth: dict[int, Pose2]
    fixes: list[PoseBelief]
    outliers: list[PoseBelief]

    def error(self, beliefs: list[PoseBelief]) -> float:
        """Root mean square position error."""
        errors = [belief.pose.minus(self.truth[belief.stamp_ns])[:2] for belief in beliefs]
        return math.sqrt(np.mean(np.sum(np.square(errors), axis=1)))

    def nees(self, belief: PoseBelief) -> float:
        error = belief.pose.minus(self.truth[belief.stamp_ns])
        return float(error @ np.linalg.solve(belief.covariance, error))


def fix_at(stamp_ns: int, x: float, y: float, phi: float, stds: tuple[float, float, float]) -> PoseBelief:
    return PoseBelief(stamp_ns, Pose2(x, y, phi), np.diag(np.square(stds)))


def simulated(
    seed: int,
    steps: int = 200,
    fix_every: int = 10,
    fix_stds: tuple[float, float, float] = (0.2, 0.03, 0.05),
    outlier_share: float = 0.0,
) -> Drive:
    """Drive a winding way; the truth is drawn around the odometry, fixes lie off the steps' stamps."""
    rng = np.random.default_rng(seed)
    initial = fix_at(0, 1.0, 2.0, 3.0, (0.1, 0.1, 0.1))
    true = Pose2.from_array(initial.pose.as_array() + rng.normal(size=3) * 0.1)
    truth, odometry, fixes, outliers = {0: true}, [], [], []
    known = [std if math.isfinite(std) else 0.0 for std in fix_stds]
    for i in range(steps):
        turn = 0.4 * math.sin(i / 17.0)
        step = wheel_step(i * STEP_NS, (i + 1) * STEP_NS, 1.0 - turn, 1.0 + turn, GEOMETRY, NOISE)
        odometry.append(step)
        forward_m, turn_rad = rng.multivariate_normal([step.forward_m, step.turn_rad], step.covariance)
        moved = OdometryStep(step.start_ns, step.stamp_ns, forward_m, turn_rad, step.covariance)
        slip_m = rng.normal() * math.sqrt(step.sideways_m2)
        halfway_ns = step.start_ns + STEP_NS // 2
        halfway = advance(true, moved.part(step.start_ns, halfway_ns)) @ Pose2(0.0, 0.5 * slip_m, 0.0)
        true = advance(halfway, moved.part(halfway_ns, step.stamp_ns)) @ Pose2(0.0, 0.5 * slip_m, 0.0)
        truth[step.stamp_ns], truth[halfway_ns] = true, halfway
        if i % fix_every == fix_every - 1:
            seen = halfway.as_array() + rng.normal(size=3) * known
            if rng.random() < outlier_share:
                seen += [rng.choice([-2.0, 2.0]), rng.uniform(-2.0, 2.0), rng.uniform(-1.0, 1.0)]
                outliers.append(fix_at(halfway_ns, *seen, fix_stds))
                fixes.append(outliers[-1])
            else:
                fixes.append(fix_at(halfway_ns, *seen, fix_stds))
    return Drive(initial, odometry, truth, fixes, outliers)


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Drive]:
    return simulated
