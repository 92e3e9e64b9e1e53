"""What a fix from a pose would be worth, before any image is taken: which edges show, and how well they fix it.

The Cramer-Rao bound of a picture in which every predicted piece is seen at its detection rate. Expected
information is a piece's information times the rate. No estimator does better; one that pairs an edge with its
neighbour does worse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.lines import LineConfig
from vision.pose import LineObservations, pose_bound
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig
from vision.weighing import map_deviations_px

#: Standard deviations beyond these are no constraint in a building.
UNCONSTRAINED_M, UNCONSTRAINED_RAD = 5.0, math.radians(45.0)


@dataclass(frozen=True, slots=True)
class ExpectationConfig:
    """What is expected of lines and edges where nothing is measured yet."""

    lines: LineConfig = field(default_factory=LineConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedLook:
    """A look from a pose of the robot as the map foretells it.

    `predicted`: the pieces long enough to be found. `rates`: (P,) the share of each that shows.
    `covariance`: (3, 3) the bound on that of (x, y, phi), [m^2, m rad, rad^2]; 1e4 where nothing constrains.
    """

    pose: Pose2
    predicted: Prediction
    rates: Array
    covariance: Array

    @property
    def segments(self) -> int:
        """How many different map segments are in view."""
        return len(np.unique(self.predicted.rows))

    @property
    def sigma_m(self) -> tuple[float | None, float | None]:
        """Standard deviations of the position along its worst and its best direction; None: unconstrained."""
        minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance[:2, :2]), 0.0)).tolist()
        return _constrained(major, UNCONSTRAINED_M), _constrained(minor, UNCONSTRAINED_M)

    @property
    def sigma_phi(self) -> float | None:
        """Standard deviation of the heading [rad]; None where it is unconstrained."""
        return _constrained(math.sqrt(self.covariance[2, 2]), UNCONSTRAINED_RAD)


def expected_look(
    projector: Projector, pose: Pose2, rows: NDArray[np.int64], config: ExpectationConfig
) -> ExpectedLook:
    """Foretell a look from a pose; `rows`: the map segments that may be visible."""
    predicted = projector.predict(pose, rows)
    predicted = _some(predicted, predicted.lengths_px >= config.lines.min_length_px)
    rates = rates_of(projector.wire_map, predicted.rows, config.evidence)
    seen = expected_observations(projector, predicted, rates, config.lines)
    return ExpectedLook(pose, predicted, rates, pose_bound(pose, projector.camera, seen))


def rates_of(wire_map: WireMap, rows: NDArray[np.int64], config: EvidenceConfig) -> Array:
    """Return the detection rates of segments, the general one where the map has not learnt it; same shape."""
    rate = wire_map.detection_rate[rows]
    result: Array = np.clip(np.where(np.isnan(rate), config.detection_rate, rate), 0.01, 0.99)
    return result


def expected_observations(
    projector: Projector, predicted: Prediction, rates: Array, config: LineConfig
) -> LineObservations:
    """Return predicted pieces as observations, each as noisy as makes its information that times its rate.

    The noise is that of an extracted line and of the edge's place in the map, which the pieces of one segment
    share.
    """
    _, segment, counts = np.unique(predicted.rows, return_inverse=True, return_counts=True)
    map_px = map_deviations_px(projector, predicted)
    line_px = config.sigma_px / math.sqrt(2.0)
    sigma = np.hypot(line_px, map_px * np.sqrt(counts[segment])) / np.sqrt(rates)
    return LineObservations(
        moments=projector.moments[predicted.rows],
        directions=projector.directions[predicted.rows],
        rays=np.concatenate(
            [predicted.ideal_px, np.full((len(predicted), 2, 1), projector.camera.focal_px)], axis=2
        ),
        sigma_middle_px=sigma,
        sigma_slope_px=sigma,
    )


def _some(predicted: Prediction, keep: NDArray[np.bool_]) -> Prediction:
    return Prediction(*(getattr(predicted, column.name)[keep] for column in fields(Prediction)))


def _constrained(sigma: float, limit: float) -> float | None:
    return sigma if sigma < limit else None
