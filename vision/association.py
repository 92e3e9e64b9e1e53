"""Pairing predicted map segments with image lines at a given pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.measurements import LineMeasurements
from vision.projection import Prediction

#: A pair may be this many standard deviations off, all uncertainties taken together.
GATE_SIGMAS = 3.0
#: Share of an image line that must lie alongside the predicted piece.
_MIN_OVERLAP = 0.5
_MIN_SHARED_PX = 5.0
#: Lines of one piece may overlap by this share of the shorter one.
_MAX_SHARED = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """K image lines, each claimed by one predicted piece.

    `pieces`: (K,) rows of the prediction, `lines`: (K,) of the image lines. `spans_px`: (K, 2) where the
    line lies along the piece, pixels from the piece's start. `distances_px`: (K, 2) signed distances of the
    line's two points from the predicted line.
    """

    pieces: NDArray[np.int64]
    lines: NDArray[np.int64]
    spans_px: Array
    distances_px: Array

    def __len__(self) -> int:
        return len(self.pieces)

    def __getitem__(self, keep: NDArray[np.bool_]) -> Matches:
        """Return some of the matches."""
        return Matches(self.pieces[keep], self.lines[keep], self.spans_px[keep], self.distances_px[keep])

    @property
    def rms_px(self) -> Array:
        """Root mean square distance of each line from its piece, (K,)."""
        result: Array = np.sqrt((self.distances_px**2).mean(axis=1))
        return result


def associate(
    predicted: Prediction, lines: LineMeasurements, pose_px: float, map_px: Array, polarity: Array
) -> Matches:
    """Pair each image line with the predicted piece that it fits best, inside a gate of 3 standard deviations.

    `pose_px`: how far the pose may still shift what is predicted. `map_px`: (P,) standard deviations of the pieces'
    places in the map, in pixels. `polarity`: (P,) +1 brighter on the right looking from the piece's start, -1
    darker, 0 unknown. A piece may claim several lines (fragments), but not two that run beside each other: the
    nearer wins.
    """
    pieces, chosen, spans, distances = _associate(
        predicted.ideal_px,
        predicted.normals,
        lines.rays,
        lines.ends_px,
        lines.lengths_px,
        lines.along,
        lines.polarity,
        lines.sigma_middle_px,
        lines.sigma_slope_px,
        pose_px,
        map_px,
        polarity,
    )
    return Matches(pieces, chosen, spans, distances)


@njit(cache=True, nogil=True)
def _associate(
    ideal: Array,
    normals: Array,
    rays: Array,
    ends: Array,
    lengths: Array,
    along: Array,
    line_polarity: Array,
    sigma_middle: Array,
    sigma_slope: Array,
    pose_px: float,
    map_px: Array,
    polarity: Array,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
    count = len(rays)
    ways = ideal[:, 1] - ideal[:, 0]
    piece_lengths = np.sqrt(ways[:, 0] ** 2 + ways[:, 1] ** 2)
    ways = ways / piece_lengths.reshape(-1, 1)
    best, least = np.full(count, -1), np.full(count, np.inf)
    spans, distances = np.empty((count, 2)), np.empty((count, 2))
    for m in range(count):
        for p in range(len(ideal)):
            wx, wy = ways[p, 0], ways[p, 1]
            cosine = along[m, 0] * wx + along[m, 1] * wy
            if abs(cosine) < 0.7 or cosine * line_polarity[m] * polarity[p] < 0.0:
                continue
            a, b, c = normals[p, 0], normals[p, 1], normals[p, 2] * rays[m, 0, 2]
            first = a * rays[m, 0, 0] + b * rays[m, 0, 1] + c
            second = a * rays[m, 1, 0] + b * rays[m, 1, 1] + c
            common = map_px[p] ** 2 + pose_px**2
            middle, slope = common + sigma_middle[m] ** 2, common + sigma_slope[m] ** 2
            square = 0.25 * ((first + second) ** 2 / middle + (second - first) ** 2 / slope)
            # Likelihood decides between pieces: a doubtful one must not take lines from a certain one.
            cost = square + math.log(middle * slope)
            if square > GATE_SIGMAS**2 or cost >= least[m]:
                continue
            start = wx * (ends[m, 0, 0] - ideal[p, 0, 0]) + wy * (ends[m, 0, 1] - ideal[p, 0, 1])
            end = wx * (ends[m, 1, 0] - ideal[p, 0, 0]) + wy * (ends[m, 1, 1] - ideal[p, 0, 1])
            low, high = min(start, end), max(start, end)
            shared = min(high, piece_lengths[p]) - max(low, 0.0)
            if shared < max(_MIN_OVERLAP * lengths[m], _MIN_SHARED_PX):
                continue
            best[m], least[m] = p, cost
            spans[m, 0], spans[m, 1] = low, high
            distances[m, 0], distances[m, 1] = first, second
    kept = _without_parallels(best, least, spans)
    return best[kept], kept, spans[kept], distances[kept]


@njit(cache=True, nogil=True)
def _without_parallels(pieces: NDArray[np.int64], costs: Array, spans: Array) -> NDArray[np.int64]:
    """Lines to keep, best first: one that overlaps an already kept line of its piece is dropped."""
    kept = np.empty(len(pieces), np.int64)
    count = 0
    for line in np.argsort(costs, kind="mergesort"):
        if pieces[line] < 0:
            continue
        free = True
        for at in range(count):
            other = kept[at]
            if pieces[other] == pieces[line]:
                shared = min(spans[other, 1], spans[line, 1]) - max(spans[other, 0], spans[line, 0])
                shorter = min(spans[other, 1] - spans[other, 0], spans[line, 1] - spans[line, 0])
                if shared >= _MAX_SHARED * shorter:
                    free = False
                    break
        if free:
            kept[count] = line
            count += 1
    return kept[:count].copy()
