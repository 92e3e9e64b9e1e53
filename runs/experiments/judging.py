"""The four categories of table 3, and how honest a pose is: one answer against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from maps.outcomes import Ambiguous, Fix, Look, PoseBelief
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.experiments.methods import Answer

#: A pose this near to the truth is still accurate, whatever pairs led to it.
NEAR_M, NEAR_RAD = 0.30, math.radians(3.0)
#: So is one inside this ellipsoid of the Cramer-Rao bound.
BOUND_CHI2 = float(chi2.ppf(0.999, 3))
#: Edges on one straight line, to this, are the same: no image line tells them apart.
_SAME_LINE_M = 0.005


class Category(StrEnum):
    """How an image ended; the first four are table 3's."""

    SUCCESS = "success"
    FALSE_NEGATIVE = "false_negative"
    CONSISTENT = "consistent_false_positive"
    INCONSISTENT = "inconsistent_false_positive"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """One answer against the truth.

    `strictly_wrong`: a fix that is not near, whatever the bound says. `truth_listed`: an ambiguous answer that has
    the truth among its poses. `error`: (3,) fix less truth in (x, y, phi), NaN without a fix. `nees`: its
    normalized squared error. `matches`: pairs, of which `right` are.
    """

    category: Category
    strictly_wrong: bool
    truth_listed: bool
    error: Array
    nees: float
    matches: int
    right: int


def judge(
    answer: Answer, truth: Pose2, bound: Array, sources: NDArray[np.int64], wire_map: WireMap
) -> Judgement:
    """Compare an answer with the truth.

    `bound`: (3, 3) the Cramer-Rao bound. `sources`: (M,) the map row that made each image line, -1 for none.
    """
    outcome = answer.outcome
    look = outcome.look
    right = _right_pairs(look, sources, wire_map)
    counts = {"matches": len(right), "right": int(right.sum())}
    nothing: Array = np.full(3, np.nan)
    match outcome:
        case Fix(belief=belief):
            error = belief.pose.minus(truth)
            near = _near(error)
            inside = float(error @ np.linalg.solve(bound, error)) <= BOUND_CHI2
            if len(right) and right.all():
                category = Category.SUCCESS
            else:
                category = Category.CONSISTENT if near or inside else Category.INCONSISTENT
            return Judgement(category, not near, False, error, _nees(belief, error), **counts)
        case Ambiguous(beliefs=beliefs):
            listed = any(_near(belief.pose.minus(truth)) for belief in beliefs)
            return Judgement(Category.AMBIGUOUS, False, listed, nothing, math.nan, **counts)
        case _:
            return Judgement(Category.FALSE_NEGATIVE, False, False, nothing, math.nan, 0, 0)


def _near(error: Array) -> bool:
    return math.hypot(error[0], error[1]) <= NEAR_M and abs(float(error[2])) <= NEAR_RAD


def _nees(belief: PoseBelief, error: Array) -> float:
    return float(error @ np.linalg.solve(belief.covariance, error))


def _right_pairs(look: Look, sources: NDArray[np.int64], wire_map: WireMap) -> NDArray[np.bool_]:
    """Which pairs have the edge that made the line, or one on the same straight line, (K,)."""
    made = sources[look.matched_image]
    return (made >= 0) & on_one_line(wire_map.endpoints, made, look.matched_map)


def on_one_line(endpoints: Array, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether pairs of segments lie on one straight line in space, (K,).

    `endpoints`: (N, 2, 3); `first`, `second`: (K,) rows of it.
    """
    start, end = endpoints[first, 0], endpoints[first, 1]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    offset = endpoints[second] - start[:, None]
    beside = np.linalg.norm(np.cross(offset, along[:, None]), axis=2)
    return np.asarray(beside.max(axis=1, initial=0.0) <= _SAME_LINE_M)
