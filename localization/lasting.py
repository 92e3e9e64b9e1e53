"""Poses and odometry's systematic errors together: the last step of smoothing, and its covariances.

GTSAM has no factor of two poses and the parameters of the motion between them, and one written in Python
costs time proportional to the number of values at each call. So the optimizers that look for wrong fixes see
motions alone, and the parameters come out of Gauss-Newton steps of the joint problem, linear in them.

Random errors have heavy tails: between two fixes they are taken to be Student distributed, which is a Gaussian
whose width is estimated along (Lange, Little and Taylor, J. American Statistical Association 1989). Where a
wheel slipped, odometry lets go; where none did, it is not wider than it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from localization.factors import in_body, motion_covariances, motion_factors, whitening
from localization.odometry import PARAMETERS
from localization.spans import Span
from maps.poses import Array

#: The parameters of neighbouring nodes are never tied more firmly, for the sake of numbers.
_LEAST = 1e-3
_UNIT_MOTION = gtsam.noiseModel.Unit.Create(3)
_UNIT_PARAMETERS = gtsam.noiseModel.Unit.Create(PARAMETERS)

#: What is linear of a motion: Jacobian of both nodes (3, 6) and right-hand side (3,), whitened.
_Lines = tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class JointConfig:
    """How poses and parameters are estimated together.

    `steps`: of Gauss-Newton, from a good start. `freedom`: degrees of freedom of the Student distribution of
    odometry between two fixes; few are heavy tails. `slip_share`: of the variance of a slip that odometry has
    anyway; between one pair of fixes in a hundred a wheel slips.
    """

    steps: int = 3
    freedom: float = 4.0
    slip_share: float = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The optimum of poses and parameters together.

    `values`: poses of the nodes. `parameters`: (spans, PARAMETERS) of each span, in their own standard deviations.
    `tree`: the last linear system, solved.
    """

    values: gtsam.Values
    parameters: Array
    tree: gtsam.GaussianBayesTree

    def covariance(self, key: int) -> Array:
        """Return a node's covariance (3, 3), in its body frame."""
        return self.tree.marginalCovariance(key)


def joint_optimum(
    looks: gtsam.NonlinearFactorGraph,
    spans: Sequence[Span],
    looked: Sequence[int],
    values: gtsam.Values,
    config: JointConfig,
) -> Joint:
    """Take Gauss-Newton steps on poses and parameters from `values`, near their optimum already.

    `looks`: priors of nodes, robust or not; `looked`: the keys of the nodes that fixes tell of.
    """
    covariances = motion_covariances(spans, config.slip_share, known=True)
    motions = motion_factors([span.end.pose for span in spans], covariances)
    headings = np.array([span.end.pose.phi for span in spans])
    lasting = np.array([span.lasting for span in spans])
    by_parameters = -whitening(headings, covariances) @ in_body(headings, lasting)
    gaps = np.searchsorted(sorted(set(looked)), np.arange(len(spans)), side="right")
    memory, parameters = _memory(spans), np.zeros((len(spans), PARAMETERS))
    widths = np.ones(len(spans))
    for step in range(config.steps):
        lines = [factor.linearize(values).jacobian() for factor in motions]
        if step:
            widths = _widths(lines, by_parameters, parameters, gaps, config.freedom)
        system = looks.linearize(values)
        for factor in (*memory, *_motions(lines, by_parameters, widths)):
            system.push_back(factor)
        # Motions are known 10,000 times better than where they begin: Cholesky's squares would lose that.
        tree = system.eliminateMultifrontal(gtsam.Ordering.OrderingType.COLAMD, gtsam.EliminateQR)
        optimum = tree.optimize()
        values = values.retract(_of_nodes(optimum, len(spans) + 1))
        parameters = np.array([optimum.at(_key(span, len(spans))) for span in range(len(spans))])
    return Joint(values, parameters, tree)


def _key(span: int, spans: int) -> int:
    """Return the key of a span's parameters: they come after those of the nodes."""
    return spans + 1 + span


def _motions(lines: Sequence[_Lines], by_parameters: Array, widths: Array) -> list[gtsam.JacobianFactor]:
    """Linearize each motion, m(p) = m Exp(B p): R (e + A dx - B p) = 0, over its width."""
    factors = []
    for key, ((slopes, right), own, width) in enumerate(zip(lines, by_parameters, widths, strict=True)):
        first, second = slopes[:, :3] / width, slopes[:, 3:] / width
        parameters = _key(key, len(lines))
        factors.append(
            gtsam.JacobianFactor(
                key, first, key + 1, second, parameters, own / width, right / width, _UNIT_MOTION
            )
        )
    return factors


def _memory(spans: Sequence[Span]) -> list[gtsam.JacobianFactor]:
    """Tie the parameters of each span to the next one's: unit normals that slowly forget."""
    identity, zero = np.eye(PARAMETERS), np.zeros(PARAMETERS)
    first = _key(0, len(spans))
    factors = [gtsam.JacobianFactor(first, identity, zero, _UNIT_PARAMETERS)]
    for key, span in enumerate(spans[1:], start=first + 1):
        kept = math.exp(-span.forgetting)
        weight = 1.0 / max(math.sqrt(1.0 - kept * kept), _LEAST)
        factors.append(
            gtsam.JacobianFactor(
                key - 1, -kept * weight * identity, key, weight * identity, zero, _UNIT_PARAMETERS
            )
        )
    return factors


def _widths(
    lines: Sequence[_Lines],
    by_parameters: Array,
    parameters: Array,
    gaps: NDArray[np.int64],
    freedom: float,
) -> Array:
    """Return how many times wider than stated each motion is, by what is left of it between two fixes.

    A gap's motions tell one displacement: three residuals, whatever their number.
    """
    left = np.array([right for _, right in lines]) - np.einsum("kij,kj->ki", by_parameters, parameters)
    squared = np.bincount(gaps, (left**2).sum(axis=1))
    widths: Array = np.sqrt(np.maximum((freedom + squared) / (freedom + 3.0), 1.0))[gaps]
    return widths


def _of_nodes(optimum: gtsam.VectorValues, count: int) -> gtsam.VectorValues:
    moves = gtsam.VectorValues()
    for key in range(count):
        moves.insert(key, optimum.at(key))
    return moves
