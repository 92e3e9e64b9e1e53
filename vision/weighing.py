"""How much each matched pair says about the pose: image noise, the map's own uncertainty, and doubts in the pair."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.association import Matches
from vision.measurements import LineMeasurements
from vision.pose import LineObservations
from vision.projection import Prediction, Projector


def map_deviations_px(projector: Projector, predicted: Prediction) -> Array:
    """Return what the map's uncertainty makes in the image, one standard deviation, pixels (P,)."""
    sigma = projector.wire_map.sigma_m[predicted.rows]
    result: Array = 2.0 * projector.camera.focal_px * sigma / predicted.depths_m.sum(axis=1)
    return result


def observations(
    projector: Projector,
    lines: LineMeasurements,
    predicted: Prediction,
    matches: Matches,
    map_px: Array,
    spread: float = 1.0,
    pose_px: float = 0.0,
    credence: Array | None = None,
) -> LineObservations:
    """Return the matched pairs as the estimator weighs them.

    `map_px`: (P,) what the map's uncertainty makes in the image, one standard deviation. `spread` scales it and the
    image's noise: a map that fits better than it promised is believed. `pose_px`: what else may shift the picture.
    `credence`: (K,) how likely each pair is right, which its log likelihood is multiplied with.
    """
    rows = predicted.rows[matches.pieces]
    middle, slope = _deviations(
        matches.pieces,
        matches.lines,
        map_px,
        predicted.lengths_px,
        lines.lengths_px,
        lines.sigma_middle_px,
        lines.sigma_slope_px,
        spread,
        pose_px,
    )
    return LineObservations(
        moments=projector.moments[rows],
        directions=projector.directions[rows],
        rays=lines.rays[matches.lines],
        sigma_middle_px=middle,
        sigma_slope_px=slope,
        credence=credence,
    )


@njit(cache=True, nogil=True)
def _deviations(
    pieces: NDArray[np.int64],
    chosen: NDArray[np.int64],
    map_px: Array,
    piece_lengths: Array,
    line_lengths: Array,
    sigma_middle: Array,
    sigma_slope: Array,
    spread: float,
    pose_px: float,
) -> tuple[Array, Array]:
    """Standard deviations (K,), (K,) of the pairs' offsets and of their slopes."""
    fragments = np.zeros(len(map_px))
    for piece in pieces:
        fragments[piece] += 1.0
    middle, slope = np.empty(len(pieces)), np.empty(len(pieces))
    for k in range(len(pieces)):
        piece, line = pieces[k], chosen[k]
        # The fragments of one segment share the error of its place in the map.
        place = map_px[piece] * math.sqrt(fragments[piece])
        turn = place * min(line_lengths[line] / piece_lengths[piece], 1.0)
        middle[k] = math.hypot(pose_px, spread * math.hypot(sigma_middle[line], place))
        slope[k] = math.hypot(pose_px, spread * math.hypot(sigma_slope[line], turn))
    return middle, slope
