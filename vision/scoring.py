"""How well an image supports a refined pose: a log-likelihood ratio against chance.

It looks at all predicted segments, seen and not seen: four accidental pairs must not beat eight right ones, and
an edge that should be in the image but is not counts against the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maps.poses import Array
from vision.accidents import accidental_share
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

    def rates(self, learnt: Array) -> Array:
        """Return how often edges show (P,), given what the map has learnt, NaN where nothing: never certain."""
        rate = np.where(np.isnan(learnt), self.detection_rate, learnt)
        result: Array = np.minimum(np.maximum(rate, 0.05), 0.95)
        return result


def log_likelihood_ratio(
    predicted: Prediction,
    matches: Matches,
    lines: LineMeasurements,
    rate: Array,
    gates_px: Array,
    sigma_px: Array,
    area_px: float,
    student: float,
    config: EvidenceConfig,
) -> float:
    """Return the evidence for a pose over chance, in nats.

    Each predicted piece is a few looks at an edge, of which the covered share are hits. A hit is worth how
    much likelier it is at the edge's rate of showing (`rate`: (P,)) than by accident,
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
    chance = accidental_share(predicted, lines, gates_px, area_px)
    chance = np.minimum(np.maximum(chance, config.min_chance), 0.5)
    hit, miss = worth(rate, chance)
    total = float((units * (covered * hit + (1.0 - covered) * miss)).sum())
    # Density of the distance under the estimator's noise against uniform over the gate.
    closeness = np.log(2.0 * gates_px[matches.pieces])
    closeness += student_log_density(matches.distances_px.mean(axis=1), sigma_px, student)
    claimed = np.minimum((matches.spans_px[:, 1] - matches.spans_px[:, 0]) / config.unit_px, 1.0)
    return total + float((claimed * closeness).sum())


def worth(rate: Array, chance: Array | float) -> tuple[Array, Array]:
    """Return what a covered and an empty look at an edge are worth over chance, [nats], (P,) each.

    `rate`: (P,) how often the edge shows. `chance`: how often an accident covers a look; one that the edge does not
    cover, an accident still may.
    """
    return np.log(rate / chance + 1.0 - rate), np.log1p(-rate)
