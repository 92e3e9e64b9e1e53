"""Beliefs and motions as GTSAM's factors.

Its Pose2 tangent is in the body frame, so covariances are turned into it on the way in and back on the way
out. Keys are indices of nodes, never times.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np

from localization.spans import Span
from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2

#: Variances between nodes are never less, for the sake of numbers: 0.1 mm and 0.006 degrees.
_LEAST = np.diag([1e-8, 1e-8, 1e-8])
#: Stands for the variance of what was not measured, [m^2].
_UNMEASURED_M2 = 1e6


def graph_of(factors: Iterable[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    """Return a graph of factors, in their order."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph


def motion_covariances(spans: Sequence[Span], slip_share: float, known: bool) -> Array:
    """Return the covariances (N, 3, 3) of spans' motions, each in the frame of its first node.

    `slip_share`: of what a slip would add. `known`: whether the systematic errors are; otherwise their covariance
    a priori is in it.
    """
    joint, slip = np.array([span.end.joint for span in spans]), np.array([span.end.slip for span in spans])
    whole = joint[:, :3, :3]
    whole = 0.5 * (whole + whole.swapaxes(1, 2)) + slip_share * slip + _LEAST
    lasting = joint[:, :3, 3:]
    covariances: Array = whole - lasting @ lasting.swapaxes(1, 2) if known else whole
    return covariances


def motion_factors(
    motions: Sequence[Pose2], covariances: Array, first: int = 0
) -> list[gtsam.BetweenFactorPose2]:
    """Tie node to node, from the first key on; `covariances` (N, 3, 3) as `motion_covariances` has them."""
    in_bodies = covariances_in_body(np.array([motion.phi for motion in motions]), covariances)
    return [
        gtsam.BetweenFactorPose2(
            key, key + 1, gtsam_pose(motion), gtsam.noiseModel.Gaussian.Covariance(covariance)
        )
        for key, (motion, covariance) in enumerate(zip(motions, in_bodies, strict=True), start=first)
    ]


def pose_factors(key: int, belief: PoseBelief, huber: float | None = None) -> list[gtsam.NonlinearFactor]:
    """Tie a node to an absolute belief, in the components that it measured; robustly with `huber`."""

    def noise(covariance: Array) -> gtsam.noiseModel.Base:
        gaussian = gtsam.noiseModel.Gaussian.Covariance(covariance)
        if huber is None:
            return gaussian
        return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), gaussian)

    pose, measured = gtsam_pose(belief.pose), belief.measured
    if measured.all():
        (covariance,) = covariances_in_body(np.array([belief.pose.phi]), belief.covariance[None])
        return [gtsam.PriorFactorPose2(key, pose, noise(covariance))]
    factors: list[gtsam.NonlinearFactor] = []
    if measured[:2].any():
        # This factor's residual is in the map frame: no rotation.
        known = np.where(np.isfinite(belief.covariance), belief.covariance, _UNMEASURED_M2)[:2, :2]
        factors.append(gtsam.PoseTranslationPrior2D(key, pose, noise(known)))
    if measured[2]:
        factors.append(gtsam.PoseRotationPrior2D(key, pose, noise(belief.covariance[2:, 2:])))
    return factors


def gtsam_pose(pose: Pose2) -> gtsam.Pose2:
    """Return a pose as GTSAM has it."""
    return gtsam.Pose2(pose.x, pose.y, pose.phi)


def belief_of(stamp_ns: int, pose: gtsam.Pose2, covariance: Array) -> PoseBelief:
    """Return a belief of a node's value and marginal covariance (3, 3)."""
    (turning,) = _turning(np.array([pose.theta()]))
    turned = turning @ covariance @ turning.T
    return PoseBelief(stamp_ns, Pose2(pose.x(), pose.y(), pose.theta()), 0.5 * (turned + turned.T))


def in_body(phi: Array, slopes: Array) -> Array:
    """Turn rows of (x, y, phi), (N, 3, n), from the frame that phi (N,) is told in into the body's."""
    return _turning(phi).swapaxes(1, 2) @ slopes


def covariances_in_body(phi: Array, covariances: Array) -> Array:
    """Turn covariances (N, 3, 3) of (x, y, phi) likewise."""
    turning = _turning(phi)
    return turning.swapaxes(1, 2) @ covariances @ turning


def whitening(phi: Array, covariances: Array) -> Array:
    """Return R, upper triangular (N, 3, 3), R' R the inverse of each covariance in the body frame.

    It is what GTSAM whitens with.
    """
    information = np.linalg.inv(covariances_in_body(phi, covariances))
    return np.linalg.cholesky(information).swapaxes(1, 2)


def _turning(phi: Array) -> Array:
    """Return map_from_body for (x, y, phi), shape (N, 3, 3)."""
    turning = np.zeros((len(phi), 3, 3))
    turning[:, 0, 0] = turning[:, 1, 1] = np.cos(phi)
    turning[:, 1, 0] = np.sin(phi)
    turning[:, 0, 1] = -turning[:, 1, 0]
    turning[:, 2, 2] = 1.0
    return turning
