"""How well an image supports a refined pose: a log-likelihood ratio against chance.

It looks at all predicted segments, seen and not seen: four accidental pairs must not beat eight right ones, and
an edge that should be in the image but is not counts against the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.association import Matches
from vision.measurements import LineMeasurements
from vision.pose import student_log_density
from vision.projection import Prediction


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """What a seen and an unseen edge are worth."""

    #: Share of a visible edge that shows in an image, where the map has not learnt it.
    detection_rate: float = 0.4
    #: Image length that counts as one independent look at an edge; clutter is correlated along a line.
    unit_px: float = 30.0
    #: No edge is worth more looks than this, however long.
    max_units: float = 5.0
    #: No image is so empty that an accidental line is less likely than this.
    min_chance: float = 0.03


def log_likelihood_ratio(
    predicted: Prediction,
    matches: Matches,
    lines: LineMeasurements,
    detection_rate: Array,
    gates_px: Array,
    sigma_px: Array,
    area_px: float,
    student: float,
    config: EvidenceConfig,
) -> float:
    """Return the evidence for a pose over chance, in nats.

    Each predicted piece is a few looks at an edge, of which the covered share are hits. A hit is worth how
    much likelier it is at the edge's detection rate (`detection_rate`: (P,), NaN where unknown) than by accident,
    and how close it lies (`sigma_px`: (K,) expected distance of each match) against anywhere inside the piece's
    gate (`gates_px`: (P,)). `area_px`: of the image. `student`: degrees of
    freedom of the noise.
    """
    if not len(predicted):
        return 0.0
    lengths = predicted.lengths_px
    ends = np.minimum(np.maximum(matches.spans_px, 0.0), lengths[matches.pieces, None])
    covered = np.bincount(matches.pieces, ends[:, 1] - ends[:, 0], minlength=len(predicted))
    covered = np.minimum(covered / lengths, 1.0)
    units = np.minimum(lengths / config.unit_px, config.max_units)
    rate = np.where(np.isnan(detection_rate), config.detection_rate, detection_rate)
    rate = np.minimum(np.maximum(rate, 0.05), 0.95)
    chance = _lines_by_accident(predicted.ideal_px, gates_px, lines.along, lines.lengths_px) / area_px
    chance = np.minimum(np.maximum(chance, config.min_chance), 0.5)
    hit, miss = np.log(rate / chance), np.log((1.0 - rate) / (1.0 - chance))
    total = float((units * (covered * hit + (1.0 - covered) * np.minimum(miss, 0.0))).sum())
    # Density of the distance under the estimator's noise against uniform over the gate.
    closeness = np.log(2.0 * gates_px[matches.pieces])
    closeness += student_log_density(matches.distances_px.mean(axis=1), sigma_px, student)
    claimed = np.minimum((matches.spans_px[:, 1] - matches.spans_px[:, 0]) / config.unit_px, 1.0)
    return total + float((claimed * closeness).sum())


@njit(cache=True, nogil=True)
def _lines_by_accident(ideal: Array, gates: Array, along: Array, lengths: Array) -> NDArray[np.float64]:
    """The area of the gates of lines with a piece's slope, (P,): where a piece would find one by accident."""
    areas = np.zeros(len(ideal))
    for p in range(len(ideal)):
        wx, wy = ideal[p, 1, 0] - ideal[p, 0, 0], ideal[p, 1, 1] - ideal[p, 0, 1]
        length = np.sqrt(wx * wx + wy * wy)
        for m in range(len(along)):
            # A line passes the gate at both ends only if its slope is that close, too.
            sine = abs(along[m, 0] * wy - along[m, 1] * wx) / length
            if sine * max(lengths[m], 1.0) <= 2.0 * gates[p] * np.sqrt(1.0 - min(sine * sine, 1.0)):
                areas[p] += 2.0 * gates[p] * lengths[m]
    return areas
