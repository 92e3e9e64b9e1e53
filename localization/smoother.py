"""The whole trajectory at once: a factor graph over odometry and all fixes, robust to wrong ones.

Nodes lie at the fixes and between them (`localization.spans`). Wrong fixes are found on motions with wide
covariances; what odometry's systematic errors are comes last, and with them covariances that hold over
gaps without fixes (`localization.lasting`).
"""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Annotated

import gtsam
from annotated_types import Gt

from localization.factors import (
    belief_of,
    graph_of,
    gtsam_pose,
    motion_covariances,
    motion_factors,
    pose_factors,
)
from localization.lasting import Joint, JointConfig, joint_optimum
from localization.odometry import OdometryStep
from localization.spans import Span, between_nodes, spans_of
from maps.outcomes import PoseBelief
from maps.poses import Pose2

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """How the graph is built and how wrong fixes are found.

    `node_spacing_s`: between fixes; dead reckoning bridges less than that without harm.
    `huber`: a fix off by more than so many standard deviations counts linearly: 96 % efficient where the three
    components are Gaussian, and images' fixes have heavier tails than that. `inlier_probability`: that a good fix
    stays inside the second pass's truncation.
    `slip_share`: of what a slip would add to odometry's covariance while wrong fixes are looked for: they must
    be gross ones, and no slip may make a right one look so.
    """

    node_spacing_s: Annotated[float, Gt(0.0)] = 0.25
    huber: float = 1.8
    inlier_probability: float = 0.999
    slip_share: float = 0.2
    joint: JointConfig = field(default_factory=JointConfig)


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """What is known of a drive with hindsight.

    `beliefs`: at the initial stamp and at every step's end, in order. `refused`: fixes taken to be wrong.
    """

    beliefs: tuple[PoseBelief, ...]
    refused: tuple[PoseBelief, ...] = ()


def smooth(
    initial: PoseBelief,
    steps: Sequence[OdometryStep],
    fixes: Sequence[PoseBelief],
    config: SmootherConfig | None = None,
    guess: Sequence[PoseBelief] = (),
) -> Smoothed:
    """Return the most probable beliefs at the initial stamp and at every step's end, given everything.

    All fixes belong here, those too that the filter refused; those before the initial stamp or after
    the last step are left out. `initial` may have infinite variances. `guess`: the filter's beliefs in order
    of time, where the optimization begins; without them it begins at dead reckoning, which an unknown
    initial heading does not allow.
    Wrong fixes are found in two passes: Huber's loss, then graduated non-convexity with truncated
    squares (Yang et al., RA-L 2020) and odometry as known inliers. Those left keep Huber's loss.
    """
    config = config or SmootherConfig()
    spans = spans_of(initial.stamp_ns, steps, config.node_spacing_s, (fix.stamp_ns for fix in fixes))
    if not spans:
        return Smoothed((initial,))
    stamps = [initial.stamp_ns, *(span.end.stamp_ns for span in spans)]
    keys = {stamp_ns: key for key, stamp_ns in enumerate(stamps)}
    measured = [(keys[fix.stamp_ns], fix) for fix in fixes if fix.stamp_ns in keys]
    joint, refused = _robust(initial, spans, measured, start_values(spans, guess or (initial,)), config)
    nodes = [
        belief_of(stamp_ns, joint.values.atPose2(key), joint.covariance(key))
        for stamp_ns, key in keys.items()
    ]
    return Smoothed((nodes[0], *between_nodes(spans, nodes)), tuple(refused))


def start_values(spans: Sequence[Span], guess: Sequence[PoseBelief]) -> gtsam.Values:
    """Dead-reckon every node from the newest guess before it, or back from the first one."""
    stamps, reckoned = [spans[0].start_ns], [Pose2(0.0, 0.0, 0.0)]
    node = reckoned[0]
    for span in spans:
        for estimate in (*span.within, span.end):
            stamps.append(estimate.stamp_ns)
            reckoned.append(node @ estimate.pose)
        node = reckoned[-1]
    guessed = [belief.stamp_ns for belief in guess]
    values = gtsam.Values()
    for key, stamp_ns in enumerate([spans[0].start_ns, *(span.end.stamp_ns for span in spans)]):
        near = guess[max(bisect_right(guessed, stamp_ns) - 1, 0)]
        then = reckoned[max(bisect_right(stamps, near.stamp_ns) - 1, 0)]
        now = reckoned[bisect_right(stamps, stamp_ns) - 1]
        values.insert(key, gtsam_pose(near.pose @ then.inverse() @ now))
    return values


def _robust(
    initial: PoseBelief,
    spans: Sequence[Span],
    fixes: Sequence[tuple[int, PoseBelief]],
    start: gtsam.Values,
    config: SmootherConfig,
) -> tuple[Joint, list[PoseBelief]]:
    """Find the wrong fixes, then the optimum of what is left; return it, and them."""
    first, looked = pose_factors(0, initial), [key for key, _ in fixes]
    values = huber_optimum(initial, spans, fixes, start, config)
    doubted = [factor for key, fix in fixes for factor in pose_factors(key, fix, config.huber)]
    joint = joint_optimum(graph_of([*first, *doubted]), spans, looked, values, config.joint)
    if not fixes:
        return joint, []
    motions = [span.moved_by(own) for span, own in zip(spans, joint.parameters, strict=True)]
    try:
        trusted = _trusted([*first, *_motions(spans, motions, config)], fixes, joint.values, config)
        right = [fixes[number] for number in trusted]
        believed = (factor for key, fix in right for factor in pose_factors(key, fix, config.huber))
        looks = graph_of([*first, *believed])
        optimum = joint_optimum(looks, spans, [key for key, _ in right], joint.values, config.joint)
        return optimum, [fix for number, (_, fix) in enumerate(fixes) if number not in trusted]
    except RuntimeError as error:  # what GTSAM raises for an indeterminate system
        logger.warning("smoothing stays with Huber's loss, the second pass failed: %s", error)
        return joint, []


def huber_optimum(
    initial: PoseBelief,
    spans: Sequence[Span],
    fixes: Sequence[tuple[int, PoseBelief]],
    start: gtsam.Values,
    config: SmootherConfig,
) -> gtsam.Values:
    """Optimize with Huber's loss on the fixes; these come with the keys of their nodes."""
    motions = [span.end.pose for span in spans]
    doubted = [factor for key, fix in fixes for factor in pose_factors(key, fix, config.huber)]
    graph = graph_of([*pose_factors(0, initial), *_motions(spans, motions, config), *doubted])
    return gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()


def _trusted(
    sure: Sequence[gtsam.NonlinearFactor],
    fixes: Sequence[tuple[int, PoseBelief]],
    start: gtsam.Values,
    config: SmootherConfig,
) -> list[int]:
    """Return the numbers of the fixes that graduated non-convexity believes."""
    parts = [pose_factors(key, fix) for key, fix in fixes]
    params = gtsam.GncLMParams()
    params.setKnownInliers(list(range(len(sure))))
    gnc = gtsam.GncLMOptimizer(graph_of([*sure, *chain.from_iterable(parts)]), start, params)
    gnc.setInlierCostThresholdsAtProbability(config.inlier_probability)
    gnc.optimize()
    weights = iter(gnc.getWeights()[len(sure) :])
    # A fix of several factors is believed as a whole.
    least = [min((next(weights) for _ in factors), default=0.0) for factors in parts]
    return [number for number, weight in enumerate(least) if weight > 0.5]


def _motions(
    spans: Sequence[Span], motions: Sequence[Pose2], config: SmootherConfig
) -> list[gtsam.BetweenFactorPose2]:
    """Tie node to node by odometry, as wide as it is with systematic errors that are not known."""
    return motion_factors(motions, motion_covariances(spans, config.slip_share, known=False))
