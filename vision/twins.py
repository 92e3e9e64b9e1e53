"""Look-alikes of a pose: other poses from which the predicted picture is the same within the noise.

A map's symmetries say where a pose may have a twin; the picture predicted there is then compared line by line.
Two pictures are alike where an image of the one, expected of its edges' detection rates, is nearly as good
evidence for the other (`vision.scoring`): what is seen here and not expected there, and what is expected there
and not seen here, adds up to less than what separates two hypotheses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import shapely

from maps.poses import Array, Pose2
from maps.symmetries import PLACES, PLACES_AT, Symmetries
from vision.localizability import ExpectationConfig, ExpectedLook, rates_of
from vision.projection import Prediction, Projector
from vision.scoring import worth
from vision.weighing import map_deviations_px


@dataclass(frozen=True, slots=True)
class TwinConfig:
    """When two pictures are the same."""

    #: Less evidence than this (nats) is no picture to compare.
    least_evidence: float = 15.0
    #: The evidence that may speak for one of two poses: absolute, and as a share of all evidence. The looks at one
    #: image are not independent; odds of 100 to 1, tempered by 4, are 18 nats.
    most_difference: float = 18.0
    most_share: float = 0.25
    #: Lines agree within so many standard deviations of image noise and map together.
    sigmas: float = 3.0
    #: Poses nearer than this to each other are one place.
    same_m: float = 0.30
    same_rad: float = math.radians(5.0)
    expectation: ExpectationConfig = field(default_factory=ExpectationConfig)


class TwinFinder:
    """Finds the look-alikes of poses in one map, through one camera."""

    def __init__(
        self, projector: Projector, symmetries: Symmetries, config: TwinConfig | None = None
    ) -> None:
        self._projector, self._symmetries = projector, symmetries
        self._config = config or TwinConfig()
        self._drops = ~symmetries.carries.reshape(len(symmetries), -1)
        self._every = np.arange(len(projector.wire_map))

    def twins(self, look: ExpectedLook) -> list[Pose2] | None:
        """Return the poses elsewhere that give the same picture; None where there is too little to compare."""
        config = self._config
        worth = self._worth(look.predicted, look.rates, np.ones(len(look.predicted)))
        total = float(worth.sum())
        if total < config.least_evidence:
            return None
        allowed = min(config.most_difference, config.most_share * total)
        found: list[Pose2] = []
        for motion in self._promising(look, worth, allowed):
            there = self._symmetries.carried(motion, look.pose)
            if not shapely.contains_xy(self._projector.wire_map.floor, there.x, there.y):
                continue
            if any(self._same(there, other) for other in (look.pose, *found)):
                continue
            if total - self._evidence(look, there) < allowed:
                found.append(there)
        return found

    def _promising(self, look: ExpectedLook, worth: Array, allowed: float) -> list[int]:
        """Motions that drop no more than the allowed evidence, those that keep most first."""
        low, high = look.predicted.spans.T[:, :, None]
        inside = (low <= PLACES_AT) & (high >= PLACES_AT)
        # A stretch too short to hold a place is judged by the nearest.
        middle = np.abs(PLACES_AT - 0.5 * (low + high))
        inside |= (middle == middle.min(axis=1, keepdims=True)) & ~inside.any(axis=1, keepdims=True)
        weight = np.maximum(worth, 0.0)[:, None] * inside / inside.sum(axis=1, keepdims=True)
        places = (PLACES * look.predicted.rows[:, None] + np.arange(PLACES))[inside]
        dropped = self._drops[:, places] @ weight[inside]
        near = np.flatnonzero(dropped < allowed)
        order: list[int] = near[np.argsort(dropped[near], kind="stable")].tolist()
        return order

    def _evidence(self, look: ExpectedLook, there: Pose2) -> float:
        """The evidence for a pose elsewhere of an image taken here, as expected."""
        predicted = self._projector.predict(there, self._every)
        if not len(predicted):
            return 0.0
        rates = rates_of(self._projector.wire_map, predicted.rows, self._config.expectation.evidence)
        return float(self._worth(predicted, rates, self._covered(look.predicted, predicted)).sum())

    def _covered(self, here: Prediction, there: Prediction) -> Array:
        """The share of each piece there, (P,), that has a piece here (of M) on it, the ends within the noise."""
        way = there.ideal_px[:, 1] - there.ideal_px[:, 0]
        lengths = there.lengths_px
        along = way / lengths[:, None]
        ends = here.ideal_px
        off = np.einsum("pi,mei->pme", there.normals[:, :2], ends)
        off += (there.normals[:, 2] * self._projector.camera.focal_px)[:, None, None]
        sigma = np.hypot(self._sigma_px(there)[:, None], self._sigma_px(here))
        agree = np.abs(off).max(axis=2) <= self._config.sigmas * sigma
        polarity = self._projector.wire_map.polarity
        sense = (ends[:, 1] - ends[:, 0]) @ way.T
        agree &= sense.T * np.outer(polarity[there.rows], polarity[here.rows]) >= 0.0
        spans = (
            np.einsum("pi,mei->pme", along, ends) - (there.ideal_px[:, 0] * along).sum(axis=1)[:, None, None]
        )
        spans = np.clip(spans, 0.0, lengths[:, None, None])
        # Pieces side by side, as of a frame's two edges, cover no more than one of them.
        covered: Array = np.where(agree, np.abs(spans[..., 1] - spans[..., 0]), 0.0).sum(axis=1) / lengths
        return np.minimum(covered, 1.0)

    def _worth(self, predicted: Prediction, rates: Array, covered: Array) -> Array:
        """Expected evidence of each piece for its pose where this share of it is in the world, (P,)."""
        config = self._config.expectation.evidence
        units = np.minimum(predicted.lengths_px / config.unit_px, config.max_units)
        hit, miss = worth(rates, config.min_chance)
        result: Array = units * (covered * rates * hit + (1.0 - covered * rates) * miss)
        return result

    def _sigma_px(self, predicted: Prediction) -> Array:
        """How far off an edge may be in the image, by noise and by the map, (P,)."""
        map_px = map_deviations_px(self._projector, predicted)
        result: Array = np.hypot(self._config.expectation.lines.sigma_px, map_px)
        return result

    def _same(self, pose: Pose2, other: Pose2) -> bool:
        x, y, phi = pose.minus(other)
        return math.hypot(x, y) <= self._config.same_m and abs(phi) <= self._config.same_rad
