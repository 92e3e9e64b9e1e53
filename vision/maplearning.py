"""What many sightings tell about a map: how often edges show, which side is bright, how well they are placed.

Detection rates are shares of predicted length, with Beta priors: a segment's is drawn towards its kind's, and a
kind's towards all. Polarity is written where the majority is clear. The standard deviation of an edge's place is
what remains of its lines' scatter after pose and noise. And some edges are not where the map has them at all.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap
from vision.mapsightings import Sightings
from vision.moved import Moved, MovedConfig, moved_segments
from vision.scoring import EvidenceConfig


@dataclass(frozen=True, slots=True)
class LearningConfig:
    """How much evidence it takes."""

    #: What a look is worth, by length, as the matcher counts it.
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    #: Looks' units that the prior of a kind's rate, and of a segment's, are worth.
    kind_units: float = 20.0
    segment_units: float = 10.0
    #: Bright on one side in this share of sightings, by Laplace's rule: eight of eight, or 17 of 18. A known side
    #: rules lines out, so that one wrong in ten costs as much as the others bring.
    polarity_share: float = 0.9
    #: Lines that a standard deviation takes, and those that its kind's is worth.
    sigma_looks: int = 5
    #: An edge that shows less often than this is paired by accident too often for its lines to tell where it is.
    sigma_share: float = 0.33
    sigma_prior_looks: float = 5.0
    #: No map is known better, as far as lines can tell [m].
    least_sigma_m: float = 0.005
    #: A segment never seen in so many images is suspicious where others of its kind would hardly be.
    missing_looks: int = 5
    missing_chance: float = 0.01
    moved: MovedConfig = field(default_factory=MovedConfig)


class Fault(StrEnum):
    """What is wrong with a segment."""

    MISSING = "missing"
    MOVED = "moved"


@dataclass(frozen=True, slots=True)
class Suspicion:
    """A segment that is not as the map says: `seen` of `looks` images show it, at an offset [m] if it moved.

    `unseen_chance`: that one of its kind would not show in as many images.
    """

    row: int
    fault: Fault
    looks: int
    seen: int
    unseen_chance: float
    offset_m: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LearntMap:
    """What was learnt of N segments, beside which of them.

    `looks`, `seen`: (N,) images in which each should show, and does. `detection_rate`: (N,) NaN where its kind was
    never looked at. `polarity`: (N,) +1, -1, or 0 where unclear. `polarity_share`: (N,) of the majority, NaN where
    never seen. `sigma_m`: (N,) NaN where it takes more lines.
    """

    looks: NDArray[np.int64]
    seen: NDArray[np.int64]
    detection_rate: Array
    polarity: Array
    polarity_share: Array
    sigma_m: Array
    suspicions: tuple[Suspicion, ...]


def learn(wire_map: WireMap, sightings: Sightings, config: LearningConfig) -> LearntMap:
    """Learn from sightings."""
    count = len(wire_map)
    looks, seen, votes = _by_image(sightings, count)
    polarity, share = _polarity(votes, config)
    moved = moved_segments(wire_map, sightings, config.moved)
    kinds = np.array(wire_map.kinds)
    return LearntMap(
        looks=looks,
        seen=seen,
        detection_rate=_rates(kinds, sightings, config),
        polarity=polarity,
        polarity_share=share,
        sigma_m=np.where(seen >= config.sigma_share * looks, _sigmas(kinds, sightings, config), np.nan),
        suspicions=_suspicions(kinds, looks, seen, moved, config),
    )


def _by_image(
    sightings: Sightings, count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Images in which each segment should show and does (N,), and in which it is darker, brighter (N, 2)."""
    keys = np.stack([sightings.frames, sightings.rows], axis=1)
    pairs, at = np.unique(keys, axis=0, return_inverse=True)
    at = at.ravel()
    bright = np.sign(np.bincount(at, sightings.brighter * sightings.lengths_px, minlength=len(pairs)))
    rows = pairs[:, 1]
    votes = np.stack([np.bincount(rows[bright == side], minlength=count) for side in (-1, 1)], axis=1)
    shown = np.bincount(at, sightings.brighter != 0.0, minlength=len(pairs)) > 0
    return np.bincount(rows, minlength=count), np.bincount(rows[shown], minlength=count), votes


def _rates(kinds: NDArray[np.str_], sightings: Sightings, config: LearningConfig) -> Array:
    """Posterior means of the detection rates, (N,)."""
    evidence = config.evidence
    units = np.minimum(sightings.lengths_px / evidence.unit_px, evidence.max_units)
    tried = np.bincount(sightings.rows, units, minlength=len(kinds))
    hits = np.bincount(sightings.rows, units * sightings.covered, minlength=len(kinds))
    overall = _shrunk(hits.sum(), tried.sum(), evidence.detection_rate, config.kind_units)
    rates = np.full(len(kinds), np.nan)
    for kind in np.unique(kinds):
        own = kinds == kind
        if tried[own].any():
            usual = _shrunk(hits[own].sum(), tried[own].sum(), overall, config.kind_units)
            rates[own] = (hits[own] + config.segment_units * usual) / (tried[own] + config.segment_units)
    return rates


def _shrunk(hits: float, tried: float, prior: float, worth: float) -> float:
    """Posterior mean of a share under a Beta prior of that mean, worth so many tries."""
    return (hits + worth * prior) / (tried + worth)


def _polarity(votes: NDArray[np.int64], config: LearningConfig) -> tuple[Array, Array]:
    """The clear majority's side (N,), 0 elsewhere, and the majority's share (N,)."""
    total, most = votes.sum(axis=1), votes.max(axis=1)
    clear = (most + 1) / (total + 2) >= config.polarity_share
    share = np.where(total > 0, most / np.maximum(total, 1), np.nan)
    return np.where(clear, np.sign(votes[:, 1] - votes[:, 0]), 0).astype(np.float64), share


def _sigmas(kinds: NDArray[np.str_], sightings: Sightings, config: LearningConfig) -> Array:
    """How well edges are placed, (N,): their lines' offsets in metres, less what pose and noise explain."""
    there = sightings.at_place
    scale = np.linalg.norm(sightings.pull[there], axis=1)
    offset, explained = sightings.off_px[there] / scale, (sightings.sigma_px[there] / scale) ** 2
    rows = sightings.line_rows[there]
    sigmas = np.full(len(kinds), np.nan)
    for kind in np.unique(kinds):
        own = kinds[rows] == kind
        if np.count_nonzero(own) < config.sigma_looks:
            continue
        usual = _excess(offset[own], explained[own])
        for row in np.unique(rows[own]):
            lines = rows == row
            number = np.count_nonzero(lines)
            if number >= config.sigma_looks:
                variance = (
                    number * _excess(offset[lines], explained[lines]) + config.sigma_prior_looks * usual
                )
                sigmas[row] = np.sqrt(variance / (number + config.sigma_prior_looks))
    result: Array = np.maximum(sigmas, config.least_sigma_m)
    return result


def _excess(offset: Array, explained: Array) -> float:
    """The variance of offsets, by their median, beyond what is explained."""
    robust = np.median(np.abs(offset)) / 0.6745
    return float(max(robust**2 - np.median(explained), 0.0))


def _suspicions(
    kinds: NDArray[np.str_],
    looks: NDArray[np.int64],
    seen: NDArray[np.int64],
    moved: dict[int, Moved],
    config: LearningConfig,
) -> tuple[Suspicion, ...]:
    """Segments that moved, and those never seen though others of their kind are; the surest first."""
    found = []
    for row in range(len(kinds)):
        own = kinds == kinds[row]
        share = (seen[own].sum() + 1.0) / (looks[own].sum() + 2.0)
        chance = float((1.0 - share) ** looks[row])
        if row in moved:
            move = moved[row]
            found.append(Suspicion(row, Fault.MOVED, move.looks, move.seen, chance, move.offset_m))
        elif not seen[row] and looks[row] >= config.missing_looks and chance < config.missing_chance:
            found.append(Suspicion(row, Fault.MISSING, int(looks[row]), 0, chance))
    return tuple(sorted(found, key=lambda suspicion: (suspicion.fault, suspicion.unseen_chance)))
