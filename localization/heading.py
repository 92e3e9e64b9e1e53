"""Finding the heading of a robot that knows only its position when it starts.

Odometry says where the robot went relative to its unknown first heading. Every position-only fix asks
which first heading would have led there: a one-dimensional posterior, computed exactly on a grid. For
each heading of the grid the rest is linear, so each carries a Kalman filter over the position of the
start as the odometry drifts (a Rao-Blackwellised grid; Thrun et al., Probabilistic Robotics, section
8.2). A fix counts no less than one just outside the gate, so no single outlier decides.
"""

from __future__ import annotations

import math
from bisect import insort
from dataclasses import dataclass

import numpy as np

from localization.ekf import quantile
from localization.odometry import OdometryStep
from localization.path import ReckonedPath
from localization.sightings import Sighting
from localization.timeline import Timeline, TimelineConfig
from localization.trust import Mind
from localization.verdicts import Fused
from localization.window import position_radius
from maps.outcomes import PoseBelief, SearchWindow
from maps.poses import Array, Pose2


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """When a heading counts as found.

    `limit_rad`: circular standard deviation; the filter's linearization is good to 1 % within twice
    this. `certainty`: posterior probability of lying within three times the limit of the mean, so of
    having a single mode. `grid`: number of headings, 1 degree apart. `widening`: the filter starts
    with the posterior's standard deviation times this, because it will see the same fixes again; of
    their information 1/9 then counts twice.
    `patience_s`, `patience_m`: a search that has found nothing after so long and so far has begun at a
    wrong position. `misses`: after so many images without a fix nearby, look for one everywhere.
    """

    limit_rad: float = math.radians(5.0)
    certainty: float = 0.999
    grid: int = 360
    widening: float = 3.0
    patience_s: float = 60.0
    patience_m: float = 3.0
    misses: int = 5


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """A Gaussian over the start's position under each heading, and how well each explains the fixes.

    `rotations`: (G, 2, 2) map_from_start. `means`: (G, 2), `covariances`: (G, 2, 2), metres, map frame,
    drift since the start included. `log_odds`: (G,). `drift`: (2, 2) of odometry up to the newest fix,
    frame of the start.
    """

    rotations: Array
    means: Array
    covariances: Array
    log_odds: Array
    drift: Array

    @classmethod
    def begin(cls, initial: PoseBelief, size: int) -> _Grid:
        headings = _headings(size)
        cos, sin = np.cos(headings), np.sin(headings)
        rotations = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        means = np.tile([initial.pose.x, initial.pose.y], (size, 1))
        covariances = np.tile(initial.covariance[:2, :2], (size, 1, 1))
        return cls(rotations, means, covariances, np.zeros(size), np.zeros((2, 2)))

    def seen(self, fix: PoseBelief, motion: PoseBelief, gate: float) -> _Grid:
        """Weigh every heading by a fix's position; `motion` is start_from_robot at its stamp."""
        added = _positive(motion.covariance[:2, :2] - self.drift)
        drifted = self.covariances + self.rotations @ added @ self.rotations.transpose(0, 2, 1)
        residuals = [fix.pose.x, fix.pose.y] - self.means - self.rotations @ [motion.pose.x, motion.pose.y]
        spread = drifted + fix.covariance[:2, :2]
        gains = drifted @ np.linalg.inv(spread)
        nis = np.einsum("gi,gi->g", residuals, np.linalg.solve(spread, residuals[..., None])[..., 0])
        peak = -0.5 * np.log(np.linalg.det(spread))
        within = nis <= quantile(gate, 2)
        odds = np.maximum(peak - 0.5 * nis, peak.max() - 0.5 * quantile(gate, 2))
        means = self.means + np.einsum("gij,gj->gi", gains, residuals)
        covariances = drifted - gains @ drifted
        return _Grid(
            self.rotations,
            np.where(within[:, None], means, self.means),
            np.where(within[:, None, None], covariances, drifted),
            self.log_odds + odds,
            motion.covariance[:2, :2],
        )


class HeadingSearch:
    """Odometry and fixes since the start, until they tell the first heading."""

    def __init__(self, initial: PoseBelief, config: HeadingConfig, parts: TimelineConfig) -> None:
        """Begin at a belief with a position and no heading; `parts`: of the timeline to hand over."""
        self._initial, self._config, self._parts = initial, config, parts
        self._motion = ReckonedPath(initial.stamp_ns)
        self._looks: list[Sighting] = []
        self._grid = _Grid.begin(initial, config.grid)

    def predict(self, step: OdometryStep) -> None:
        """Follow the odometry in the frame of the start."""
        self._motion.append(step)

    def stuck(self, stamp_ns: int) -> bool:
        """Tell whether it has gone on for so long that the start cannot be right."""
        motion = self._motion.belief_at(stamp_ns)
        if motion is None or (stamp_ns - self._initial.stamp_ns) * 1e-9 <= self._config.patience_s:
            return False
        return math.hypot(motion.pose.x, motion.pose.y) > self._config.patience_m

    def gather(self, look: Sighting) -> Timeline | None:
        """Take a look with one place; return the replayed timeline once it shows the heading, else None."""
        fix = look.places[0]
        motion = self._motion.belief_at(fix.stamp_ns)
        if motion is None:
            return None
        insort(self._looks, look, key=lambda look: look.order)
        if fix.measured[2]:
            variance = fix.covariance[2, 2] + motion.covariance[2, 2]
            return self._start(look, fix.pose.phi - motion.pose.phi, math.sqrt(variance))
        if self._looks[-1] is look:
            self._grid = self._grid.seen(fix, motion, self._parts.gate)
        else:
            self._grid = self._seen_again()
        found = self._found()
        return self._start(look, *found) if found else None

    def window_at(self, stamp_ns: int, probability: float) -> SearchWindow:
        """Return where the robot can be: as far from the start as odometry went, in any direction."""
        initial, motion = self._initial, self._motion.belief_at(stamp_ns)
        reach = position_radius(initial.covariance[:2, :2], probability)
        if motion is not None:
            reach += math.hypot(motion.pose.x, motion.pose.y)
            reach += position_radius(motion.covariance[:2, :2], probability)
        return SearchWindow(initial.pose, reach, math.pi)

    def _seen_again(self) -> _Grid:
        grid = _Grid.begin(self._initial, self._config.grid)
        for fix in (look.places[0] for look in self._looks):
            motion = self._motion.belief_at(fix.stamp_ns)
            if motion is not None and not fix.measured[2]:
                grid = grid.seen(fix, motion, self._parts.gate)
        return grid

    def _found(self) -> tuple[float, float] | None:
        """Return the posterior's circular mean and standard deviation if it is narrow and has one mode."""
        headings, limit = _headings(self._config.grid), self._config.limit_rad
        weights = np.exp(self._grid.log_odds - self._grid.log_odds.max())
        weights /= weights.sum()
        resultant = complex(weights @ np.exp(1j * headings))
        mean = math.atan2(resultant.imag, resultant.real)
        std = math.sqrt(-2.0 * math.log(min(abs(resultant), 1.0)))
        near = np.cos(headings - mean) > math.cos(3.0 * limit)
        if std > limit or weights[near].sum() < self._config.certainty:
            return None
        return mean, std

    def _start(self, newest: Sighting, phi: float, std: float) -> Timeline | None:
        """Start the filter at the first stamp and replay; None where the newest fix does not fit in."""
        covariance = np.array(self._initial.covariance)
        covariance[2, 2] = (self._config.widening * std) ** 2
        pose = Pose2(self._initial.pose.x, self._initial.pose.y, phi)
        anchor = PoseBelief(self._initial.stamp_ns, pose, covariance)
        mind = Mind.at(anchor, self._parts.hypotheses)
        timeline = Timeline(anchor.stamp_ns, mind, self._parts, self._looks)
        for step in self._motion.steps:
            timeline.append(step)
        return timeline if isinstance(timeline.verdict_of(newest), Fused) else None


def _headings(size: int) -> Array:
    return np.linspace(-np.pi, np.pi, size, endpoint=False)


def _positive(covariance: Array) -> Array:
    """Return the part of a symmetric matrix (2, 2) that is a covariance: way back undoes drift."""
    values, vectors = np.linalg.eigh(covariance)
    positive: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return positive
