"""Smoothing while the robot drives: every pose as it is known a few seconds later.

A factor graph over the last seconds (GTSAM's incremental fixed-lag smoother); what is older stays in it as a
prior. Odometry's systematic errors come from the filter, which has them already.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import gtsam
import numpy as np
from annotated_types import Gt

from localization.ekf import Estimate
from localization.factors import (
    belief_of,
    graph_of,
    gtsam_pose,
    motion_covariances,
    motion_factors,
    pose_factors,
)
from localization.odometry import OdometryStep
from localization.spans import Span, SpanChain, between_nodes
from maps.outcomes import PoseBelief
from maps.poses import Pose2


@dataclass(frozen=True, slots=True)
class FixedLagConfig:
    """How far one looks back.

    `enabled`: whether it runs at all. `lag_s`: so much later a pose is told. `node_spacing_s`: a fix counts at
    the next node. `huber`: a fix off by more than so many standard deviations counts linearly.
    `slip_share`: of what a slip would add to odometry's covariance.
    """

    enabled: bool = True
    lag_s: Annotated[float, Gt(0.0)] = 5.0
    node_spacing_s: Annotated[float, Gt(0.0)] = 0.25
    huber: float = 1.8
    slip_share: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    """A node with its key, and the span that led to it; the first one has none."""

    key: int
    stamp_ns: int
    span: Span | None


class FixedLagSmoother:
    """Takes odometry and the fixes that the filter accepted, and tells each pose one lag later."""

    def __init__(self, config: FixedLagConfig | None = None) -> None:
        """Begin with nothing: the first estimate of the filter is the first node."""
        self._config = config or FixedLagConfig()
        self._window: _Window | None = None

    def move(self, step: OdometryStep, estimate: Estimate | None) -> list[PoseBelief]:
        """Follow a step, and return the beliefs that are a lag old now, in order of time.

        `estimate`: the filter's at the step's end; None while it is lost, which ends the window.
        """
        if estimate is None:
            return self.rest()
        if self._window is None:
            self._window = _Window(estimate, self._config)
            return []
        return list(self._window.move(step, estimate))

    def fuse(self, fix: PoseBelief) -> None:
        """Take a fix, late or not; one that is older than the window is left out."""
        if self._window is not None:
            self._window.fuse(fix)

    def rest(self) -> list[PoseBelief]:
        """Return what was not told yet, and begin anew: at the end, or where the filter found another place."""
        window, self._window = self._window, None
        return list(window.rest()) if window else []


class _Window:
    """The last seconds without a break."""

    def __init__(self, start: Estimate, config: FixedLagConfig) -> None:
        self._config, self._latest = config, start
        self._chain = SpanChain(start.stamp_ns, config.node_spacing_s)
        # Nodes must be there still when they are told, and a late fix must not meet one about to go.
        self._span_s = config.lag_s + 4.0 * config.node_spacing_s
        params = gtsam.ISAM2Params()
        params.relinearizeSkip = 1
        self._graph = gtsam.IncrementalFixedLagSmoother(self._span_s, params)
        self._fixes = list[PoseBelief]()
        self._waiting = deque[_Node]()
        self._told: PoseBelief | None = None
        self._recent = deque[_Node]([_Node(0, start.stamp_ns, None)])
        self._add(self._recent[0], pose_factors(0, start.belief), start.pose)

    def fuse(self, fix: PoseBelief) -> None:
        self._fixes.append(fix)

    def move(self, step: OdometryStep, estimate: Estimate) -> Iterator[PoseBelief]:
        """Add a step and yield what is a lag old."""
        self._latest = estimate
        for span in self._chain.follow(step):
            # Those that the update drops, after a hole in the odometry.
            yield from self._tell(span.end.stamp_ns - self._span_s * 1e9)
            self._extend(span)
            yield from self._tell(span.end.stamp_ns - self._config.lag_s * 1e9)

    def rest(self) -> Iterator[PoseBelief]:
        """Yield all that was not told."""
        for span in self._chain.rest():
            yield from self._tell(span.end.stamp_ns - self._span_s * 1e9)
            self._extend(span)
        yield from self._tell(float("inf"))

    def _extend(self, span: Span) -> None:
        """Add a node by odometry, with the fixes that came meanwhile."""
        last, parameters = self._recent[-1], self._latest.mean[3:]
        node, motion = _Node(last.key + 1, span.end.stamp_ns, span), span.moved_by(parameters)
        covariances = motion_covariances([span], self._config.slip_share, known=True)
        covariances = covariances + span.lasting @ self._latest.joint[3:, 3:] @ span.lasting.T
        pose = _pose_of(self._graph.calculateEstimatePose2(last.key)) @ motion
        self._recent.append(node)
        while self._recent[0].stamp_ns < node.stamp_ns - self._config.lag_s * 1e9:
            self._recent.popleft()
        factors: list[gtsam.NonlinearFactor] = [*motion_factors([motion], covariances, last.key)]
        reached = [fix for fix in self._fixes if fix.stamp_ns <= node.stamp_ns]
        self._fixes = [fix for fix in self._fixes if fix.stamp_ns > node.stamp_ns]
        for fix in reached:
            factors += self._look(fix)
        self._add(node, factors, pose)

    def _look(self, fix: PoseBelief) -> list[gtsam.NonlinearFactor]:
        """Carry a fix to the node after it; what odometry errs on that bit of way is less than the fix does."""
        for node in self._recent:
            span = node.span
            if span is not None and span.start_ns < fix.stamp_ns <= node.stamp_ns:
                start = _pose_of(self._graph.calculateEstimatePose2(node.key - 1))
                return pose_factors(node.key, _carried(fix, start, span), self._config.huber)
        return []

    def _add(self, node: _Node, factors: list[gtsam.NonlinearFactor], pose: Pose2) -> None:
        values = gtsam.Values()
        values.insert(node.key, gtsam_pose(pose))
        self._graph.update(graph_of(factors), values, {node.key: node.stamp_ns * 1e-9})
        self._waiting.append(node)

    def _tell(self, until_ns: float) -> Iterator[PoseBelief]:
        """Yield the beliefs of the nodes up to a stamp, and at odometry's stamps on the way to them."""
        while self._waiting and self._waiting[0].stamp_ns <= until_ns:
            node = self._waiting.popleft()
            pose = self._graph.calculateEstimatePose2(node.key)
            belief = belief_of(node.stamp_ns, pose, self._graph.marginalCovariance(node.key))
            if self._told is None or node.span is None:
                yield belief
            else:
                yield from between_nodes([node.span], [self._told, belief])
            self._told = belief


def _pose_of(pose: gtsam.Pose2) -> Pose2:
    return Pose2(pose.x(), pose.y(), pose.theta())


def _carried(fix: PoseBelief, start: Pose2, span: Span) -> PoseBelief:
    """Move a fix on to the end of its span, with the lever arm of its heading's error.

    `start`: the pose where the span begins, for the heading of a fix that has none.
    """
    until = span.until(fix.stamp_ns)
    seen = fix.pose if fix.measured[2] else Pose2(fix.pose.x, fix.pose.y, start.phi + until.phi)
    pose, covariance = seen @ until.inverse() @ span.end.pose, fix.covariance
    if fix.measured[2]:
        transition = np.eye(3)
        transition[0, 2], transition[1, 2] = seen.y - pose.y, pose.x - seen.x
        covariance = transition @ covariance @ transition.T
    return PoseBelief(span.end.stamp_ns, pose, covariance)
