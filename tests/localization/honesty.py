"""Simulated sessions through the filter alone, and how honest it was."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from localization.ekf import Estimate, innovation, predict, update
from localization.odometry import OdometryNoise, OdometryStep
from maps.poses import wrap_angle
from runs.session import Session
from runs.simulation.paths import Drive
from runs.simulation.synthetic import SessionPlan, simulate_session

GATE = 0.999
#: Beliefs are judged so often along the drive, steps apart.
EVERY = 25


@dataclass(frozen=True, slots=True)
class Honesty:
    """Over many sessions: mean NEES over its dimension, mean NIS over its own, share of fixes refused.

    `band`: 99.9 % interval of that mean NIS if the filter is honest.
    """

    anees: float
    anis: float
    refused: float
    band: tuple[float, float]


def honesty_of(plan: SessionPlan, noise: OdometryNoise, seeds: Iterable[int]) -> Honesty:
    """Run seeded sessions."""
    nees, nis = list[float](), list[float]()
    for seed in seeds:
        simulated = simulate_session(np.random.default_rng(seed), plan)
        errors, squared = _filtered(simulated.session, simulated.drive, noise)
        nees.append(float(np.mean(errors)))
        nis += squared
    dof = 3 * len(nis)
    gate = chi2.ppf(GATE, 3)
    low, high = (float(chi2.ppf(p, dof) / dof) for p in (0.0005, 0.9995))
    return Honesty(
        float(np.mean(nees)), float(np.mean(nis)) / 3, float(np.mean(np.array(nis) > gate)), (low, high)
    )


def _filtered(session: Session, drive: Drive, noise: OdometryNoise) -> tuple[list[float], list[float]]:
    """Return the NEES over its dimension along the drive, and the NIS of every fix."""
    assert session.initial is not None
    estimate, fixes = Estimate.of(session.initial), sorted(session.fixes, key=lambda fix: fix.stamp_ns)
    waiting = [fix.fix.belief for fix in fixes]
    nees, nis = list[float](), list[float]()
    for count, step in enumerate(session.events(noise)):
        if not isinstance(step, OdometryStep):
            continue
        here_ns = step.start_ns
        while waiting and waiting[0].stamp_ns <= step.stamp_ns:
            fix = waiting.pop(0)
            if fix.stamp_ns > here_ns:
                estimate, here_ns = predict(estimate, step.part(here_ns, fix.stamp_ns)), fix.stamp_ns
            news = innovation(estimate, fix)
            nis.append(news.nis)
            if news.inside(GATE):
                estimate = update(estimate, fix, news)
        if here_ns < step.stamp_ns:
            estimate = predict(estimate, step.part(here_ns, step.stamp_ns))
        if count % EVERY == 0:
            error = estimate.mean[:3] - drive.at(np.array([step.stamp_ns]))[0]
            error[2] = wrap_angle(float(error[2]))
            nees.append(float(error @ np.linalg.solve(estimate.joint[:3, :3], error)) / 3)
    return nees, nis
