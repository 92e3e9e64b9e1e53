"""How often image lines turn up by accident where a segment is predicted, and how far a match is to be believed."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.association import Matches
from vision.measurements import LineMeasurements
from vision.pose import student_log_density
from vision.projection import Prediction


def accidental_share(
    predicted: Prediction, lines: LineMeasurements, gates_px: Array, area_px: float
) -> Array:
    """Return the share of each predicted piece's gate that accidental lines would cover, (P,).

    `gates_px`: (P,) half widths. `area_px`: of the image, over which lines are taken to be spread evenly.
    """
    areas: Array = _lines_by_accident(predicted.ideal_px, gates_px, lines.along, lines.lengths_px)
    return areas / area_px


def credence(
    matches: Matches, sigma_px: Array, rate: Array, accidents_per_px: Array, student: float
) -> Array:
    """Return how likely each of K matched lines is its segment's and no accident, (K,).

    The association probability of probabilistic data association (Bar-Shalom, Tse 1975). `sigma_px`: (K,) expected
    distance of a right one, `rate`: (K,) how often the segment shows, `accidents_per_px`: (K,) how often an
    accidental line shows, per pixel across. `student`: degrees of freedom of the distances.
    """
    density = np.exp(student_log_density(matches.distances_px.mean(axis=1), sigma_px, student))
    right = rate * density
    result: Array = right / (right + (1.0 - rate) * accidents_per_px)
    return result


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
