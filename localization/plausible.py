"""Odometry that no wheel can have rolled: counters that jump, overflow or begin anew, rows that read nonsense.

A robot accelerates no harder than its wheels grip. What a step says beyond that is taken as not measured: better a
step without a measurement, and a covariance that says so, than half a metre and a quarter turn that never happened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from localization.odometry import OdometryStep


@dataclass(frozen=True, slots=True)
class PlausibleConfig:
    """What a robot on wheels cannot do.

    Between two steps the speed changes by no more than `forward_mps2` and `turn_radps2` allow in the time: rubber on
    a floor grips with 1 g. Nor does it change by more than `forward_mps` and `turn_radps` at all. `forward_m`,
    `turn_rad`: allowed besides, for stamps that jitter.
    """

    forward_m: float = 0.05
    turn_rad: float = 0.2
    forward_mps2: float = 10.0
    turn_radps2: float = 50.0
    forward_mps: float = 5.0
    turn_radps: float = 10.0


class Plausibility:
    """Lets through the steps that wheels can have rolled; `refused` counts the others."""

    def __init__(self, config: PlausibleConfig | None = None) -> None:
        """Begin with a robot of which nothing is known."""
        self._config = config or PlausibleConfig()
        self._last: OdometryStep | None = None
        self.refused = 0

    def checked(self, step: OdometryStep) -> OdometryStep:
        """Return the step, or in its place the last good one's motion gone on with; steps come in order of time."""
        if self._possible(step):
            self._last = step
            return step
        self.refused += 1
        return self._guessed(step)

    def _possible(self, step: OdometryStep) -> bool:
        config, took_s = self._config, (step.stamp_ns - step.start_ns) * 1e-9
        forward_m, turn_rad, since_s = 0.0, 0.0, math.inf
        if self._last is not None:
            so_far = self._last.part(step.start_ns, step.stamp_ns)
            forward_m, turn_rad = so_far.forward_m, so_far.turn_rad
            since_s = (step.stamp_ns - self._last.stamp_ns) * 1e-9
        faster_mps = min(config.forward_mps2 * since_s, config.forward_mps)
        faster_radps = min(config.turn_radps2 * since_s, config.turn_radps)
        return (
            abs(step.forward_m - forward_m) <= config.forward_m + faster_mps * took_s
            and abs(step.turn_rad - turn_rad) <= config.turn_rad + faster_radps * took_s
        )

    def _guessed(self, step: OdometryStep) -> OdometryStep:
        if self._last is None:
            return replace(step, forward_m=0.0, turn_rad=0.0, systematic=np.zeros_like(step.systematic))
        return self._last.gone_on(step.start_ns, step.stamp_ns)
