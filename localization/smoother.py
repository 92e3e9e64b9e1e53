"""The whole trajectory at once: a factor graph over odometry and all fixes, robust to wrong ones.

GTSAM's Pose2 tangent is in the body frame, so covariances are rotated into it on the way in and back
on the way out.
"""

from __future__ import annotations

import logging
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from localization.ekf import Estimate, predict
from localization.history import order_of
from localization.odometry import OdometryStep
from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """How the graph is built and how wrong fixes are found.

    `node_spacing_s`: between fixes; dead reckoning bridges less than that without harm.
    `huber`: residuals beyond so many standard deviations count linearly in the first pass (Huber's
    95 % efficiency). `inlier_probability`: that a good fix stays inside the second pass's truncation.
    `slip_share`: of what a slip would add to odometry's covariance. The graph knows neither slips nor errors
    that last, so its odometry must be wide enough for some of both.
    `least_m`, `least_rad`: standard deviation between nodes that keeps the graph well-conditioned.
    """

    node_spacing_s: float = 0.25
    huber: float = 1.345
    inlier_probability: float = 0.999
    slip_share: float = 0.2
    least_m: float = 1e-3
    least_rad: float = 1e-3


#: Stands for the variance of what was not measured, [m^2].
_UNMEASURED_M2 = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class _Span:
    """Odometry from one node to the next: the steps' ends within, and the next node, seen from the first."""

    start_ns: int
    within: tuple[PoseBelief, ...]
    end: PoseBelief


def smooth(
    initial: PoseBelief,
    steps: Sequence[OdometryStep],
    fixes: Sequence[PoseBelief],
    config: SmootherConfig | None = None,
    guess: Sequence[PoseBelief] = (),
) -> list[PoseBelief]:
    """Return the most probable beliefs at the initial stamp and at every step's end, given everything.

    All fixes belong here, those too that the filter refused; those before the initial stamp or after
    the last step are left out. `guess`: the filter's beliefs in order of time, where the optimization
    begins; without them it begins at dead reckoning, which an unknown initial heading does not allow.
    Wrong fixes are found in two passes: Huber's loss, then graduated non-convexity with truncated
    squares (Yang et al., RA-L 2020) and odometry as known inliers.
    """
    config = config or SmootherConfig()
    spans = list(_spans(initial, steps, {fix.stamp_ns for fix in fixes}, config))
    if not spans:
        return [initial]
    stamps = [initial.stamp_ns, *(span.end.stamp_ns for span in spans)]
    keys = {stamp_ns: key for key, stamp_ns in enumerate(stamps)}
    inside = sorted((fix for fix in fixes if fix.stamp_ns in keys), key=order_of)
    measured = [(keys[fix.stamp_ns], fix) for fix in inside]
    start = _start_values(spans, guess or (initial,))
    graph, values = _robust(_sure_factors(initial, spans, config), measured, start, config)
    marginals = gtsam.Marginals(graph, values)
    nodes = [_node(stamp_ns, key, values, marginals) for stamp_ns, key in keys.items()]
    return [nodes[0], *_between_nodes(spans, nodes)]


def _spans(
    initial: PoseBelief, steps: Sequence[OdometryStep], fix_stamps: set[int], config: SmootherConfig
) -> Iterator[_Span]:
    """Chain the steps from node to node; nodes lie at the fixes, and often enough between them."""
    ordered, spacing_ns = sorted(fix_stamps), config.node_spacing_s * 1e9
    last = OdometryStep(initial.stamp_ns - 1, initial.stamp_ns, 0.0, 0.0, np.zeros((2, 2)))
    start_ns, here, within = initial.stamp_ns, _origin(initial.stamp_ns), []
    for piece in (piece for step in steps for piece in last.then(step)):
        last = piece
        first, end = bisect_right(ordered, piece.start_ns), bisect_right(ordered, piece.stamp_ns)
        for cut_ns in sorted({*ordered[first:end], piece.stamp_ns}):
            here = predict(here, piece.part(here.stamp_ns, cut_ns))
            if cut_ns == piece.stamp_ns:
                within.append(_loose(here, config))
            if cut_ns in fix_stamps or cut_ns - start_ns >= spacing_ns:
                yield _Span(start_ns, tuple(within), _loose(here, config))
                start_ns, here, within = cut_ns, _origin(cut_ns), []
    if within:
        yield _Span(start_ns, tuple(within), _loose(here, config))


def _loose(estimate: Estimate, config: SmootherConfig) -> PoseBelief:
    covariance = estimate.covariance + config.slip_share * estimate.slip
    return PoseBelief(estimate.stamp_ns, estimate.pose, covariance)


def _origin(stamp_ns: int) -> Estimate:
    return Estimate.of(PoseBelief(stamp_ns, Pose2(0.0, 0.0, 0.0), np.zeros((3, 3))))


def _start_values(spans: Sequence[_Span], guess: Sequence[PoseBelief]) -> gtsam.Values:
    """Dead-reckon every node from the newest guess before it, or back from the first one."""
    stamps, reckoned = [spans[0].start_ns], [Pose2(0.0, 0.0, 0.0)]
    node = reckoned[0]
    for span in spans:
        for belief in (*span.within, span.end):
            stamps.append(belief.stamp_ns)
            reckoned.append(node @ belief.pose)
        node = reckoned[-1]
    guessed = [belief.stamp_ns for belief in guess]
    values = gtsam.Values()
    for key, stamp_ns in enumerate([spans[0].start_ns, *(span.end.stamp_ns for span in spans)]):
        near = guess[max(bisect_right(guessed, stamp_ns) - 1, 0)]
        then = reckoned[max(bisect_right(stamps, near.stamp_ns) - 1, 0)]
        now = reckoned[bisect_right(stamps, stamp_ns) - 1]
        values.insert(key, _gtsam_pose(near.pose @ then.inverse() @ now))
    return values


def _sure_factors(
    initial: PoseBelief, spans: Sequence[_Span], config: SmootherConfig
) -> list[gtsam.NonlinearFactor]:
    """Tie node to node by odometry, and the first one to the initial belief."""
    least = np.diag([config.least_m**2, config.least_m**2, config.least_rad**2])
    factors = _pose_factors(0, initial)
    for key, span in enumerate(spans):
        noise = gtsam.noiseModel.Gaussian.Covariance(_in_body(span.end) + least)
        factors.append(gtsam.BetweenFactorPose2(key, key + 1, _gtsam_pose(span.end.pose), noise))
    return factors


def _pose_factors(key: int, belief: PoseBelief, huber: float | None = None) -> list[gtsam.NonlinearFactor]:
    """Tie a node to an absolute belief, in the components that it measured; robustly with `huber`."""

    def noise(covariance: Array) -> gtsam.noiseModel.Base:
        gaussian = gtsam.noiseModel.Gaussian.Covariance(covariance)
        if huber is None:
            return gaussian
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), gaussian)

    pose, measured = _gtsam_pose(belief.pose), belief.measured
    if measured.all():
        return [gtsam.PriorFactorPose2(key, pose, noise(_in_body(belief)))]
    factors: list[gtsam.NonlinearFactor] = []
    if measured[:2].any():
        # This factor's residual is in the map frame: no rotation.
        known = np.where(np.isfinite(belief.covariance), belief.covariance, _UNMEASURED_M2)[:2, :2]
        factors.append(gtsam.PoseTranslationPrior2D(key, pose, noise(known)))
    if measured[2]:
        factors.append(gtsam.PoseRotationPrior2D(key, pose, noise(belief.covariance[2:, 2:])))
    return factors


def _robust(
    sure: Sequence[gtsam.NonlinearFactor],
    fixes: Sequence[tuple[int, PoseBelief]],
    start: gtsam.Values,
    config: SmootherConfig,
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Optimize twice; return the graph of what was believed at the end, and its optimum."""
    doubted = [factor for key, fix in fixes for factor in _pose_factors(key, fix, config.huber)]
    graph = _graph([*sure, *doubted])
    values = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    doubtful = [factor for key, fix in fixes for factor in _pose_factors(key, fix)]
    if not doubtful:
        return graph, values
    params = gtsam.GncLMParams()
    params.setKnownInliers(list(range(len(sure))))
    try:
        gnc = gtsam.GncLMOptimizer(_graph([*sure, *doubtful]), values, params)
        gnc.setInlierCostThresholdsAtProbability(config.inlier_probability)
        values_gnc = gnc.optimize()
        weights = gnc.getWeights()[len(sure) :]
        trusted = [factor for factor, weight in zip(doubtful, weights, strict=True) if weight > 0.5]
        graph_gnc = _graph([*sure, *trusted])
        return graph_gnc, gtsam.LevenbergMarquardtOptimizer(graph_gnc, values_gnc).optimize()
    except RuntimeError as error:  # what GTSAM raises for an indeterminate system
        logger.warning("smoothing stays with Huber's loss, the second pass failed: %s", error)
        return graph, values


def _graph(factors: Sequence[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph


def _gtsam_pose(pose: Pose2) -> gtsam.Pose2:
    return gtsam.Pose2(pose.x, pose.y, pose.phi)


def _turning(phi: float) -> Array:
    """Return map_from_body for (x, y, phi), shape (3, 3)."""
    cos, sin = math.cos(phi), math.sin(phi)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _in_body(belief: PoseBelief) -> Array:
    """Return the belief's covariance in its own body frame."""
    turning = _turning(belief.pose.phi)
    return turning.T @ belief.covariance @ turning


def _node(stamp_ns: int, key: int, values: gtsam.Values, marginals: gtsam.Marginals) -> PoseBelief:
    pose = values.atPose2(key)
    turning = _turning(pose.theta())
    covariance = turning @ marginals.marginalCovariance(key) @ turning.T
    return PoseBelief(stamp_ns, Pose2(pose.x(), pose.y(), pose.theta()), 0.5 * (covariance + covariance.T))


def _between_nodes(spans: Sequence[_Span], nodes: Sequence[PoseBelief]) -> Iterator[PoseBelief]:
    """Dead-reckon between the nodes, with what is left at the next node spread over the time."""
    for span, first, second in zip(spans, nodes[:-1], nodes[1:], strict=True):
        left = second.pose.minus(first.pose @ span.end.pose)
        for belief in span.within:
            share = (belief.stamp_ns - span.start_ns) / (span.end.stamp_ns - span.start_ns)
            pose = Pose2.from_array((first.pose @ belief.pose).as_array() + share * left)
            covariance = (1.0 - share) * first.covariance + share * second.covariance
            yield PoseBelief(belief.stamp_ns, pose, covariance)
