"""What one image of a known place tells about the map's edges: which showed, where, and which side was bright.

The pose is nearly known, from a whole run. What is left of its error, and of the camera's, is estimated from all
matched lines; each edge is then measured against the estimate of all the others, so that an edge that is not
where the map says cannot hide by pulling the pose along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from vision.association import Matches, associate
from vision.lines import ImageSegments, LineConfig
from vision.measurements import LineMeasurements, measured_lines
from vision.pose import LineObservations, distances_and_jacobian, estimate_pose, nuisance_information
from vision.projection import Prediction, Projector
from vision.weighing import map_deviations_px

#: Columns of the estimator's Jacobian for the camera's x, y and height: minus those for moving an edge.
_PLACE = [0, 1, 3]


@dataclass(frozen=True, slots=True)
class SightingConfig:
    """How an image is compared with the map."""

    lines: LineConfig = field(default_factory=LineConfig)
    #: How far the pose may shift what is predicted, pass by pass; the last leaves the map's and the lines' errors.
    pose_px: tuple[float, ...] = (4.0, 2.0, 1.0)
    #: What an end point of a real edge is off its straight, sharp ideal.
    edge_model_px: float = 0.5
    #: An image that fits fewer segments, or puts the robot farther from where it was, tells nothing.
    least_segments: int = 6
    astray_m: float = 0.3
    astray_rad: float = math.radians(4.0)
    #: How far from its place an edge is looked for, and how much its direction may differ.
    search_m: float = 0.15
    search_rad: float = math.radians(4.0)
    #: A line that covers less of a piece than this is an accident.
    least_share: float = 0.3
    #: A line may be a piece elsewhere if it runs beside this share of the longer of the two.
    least_beside: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """L looks at edges, and S lines that may be the edges looked at; several images' follow each other.

    `frames`, `rows`: (L,) the image's number and the map segment. `lengths_px`: (L,) of the piece that should show;
    `covered`: (L,) the share of it that does. `brighter`: (L,) +1 where the line is brighter on the right-hand
    side looking along p0 -> p1 in the image, -1 darker, 0 not seen.
    `line_frames`, `line_rows`: (S,). `off_px`, `sigma_px`: (S,) the distance of the line's middle from the edge as
    predicted without it, and its standard deviation by pose and noise. `pull`: (S, 3) how that distance changes
    where the edge moves [px/m, map frame]. `at_place`: (S,) whether the line is taken for the edge where it is.
    """

    frames: NDArray[np.int64]
    rows: NDArray[np.int64]
    lengths_px: Array
    covered: Array
    brighter: Array
    line_frames: NDArray[np.int64]
    line_rows: NDArray[np.int64]
    off_px: Array
    sigma_px: Array
    pull: Array
    at_place: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rows)

    @classmethod
    def joined(cls, parts: list[Sightings]) -> Self:
        """Return the sightings of several images (at least one) as one."""
        return cls(
            *(np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(cls))
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """An image at its best pose: what is predicted, matched, and the information on the state, (10, 10)."""

    state: Array
    predicted: Prediction
    matches: Matches
    information: Array


def sightings_of(
    projector: Projector, pose: Pose2, segments: ImageSegments, frame: int, config: SightingConfig
) -> Sightings | None:
    """Compare an image's segments with the map from nearly where it was taken; None where they do not agree."""
    lines = measured_lines(segments, projector.camera.focal_px, config.edge_model_px)
    fit = _fitted(projector, pose, lines, config)
    if fit is None:
        return None
    predicted, matches = fit.predicted, fit.matches
    lengths = predicted.lengths_px
    spans = np.clip(matches.spans_px, 0.0, lengths[matches.pieces, None])
    overlap = spans[:, 1] - spans[:, 0]
    covered = np.minimum(np.bincount(matches.pieces, overlap, minlength=len(predicted)) / lengths, 1.0)
    way = predicted.ideal_px[:, 1] - predicted.ideal_px[:, 0]
    sense = np.sign((lines.along[matches.lines] * way[matches.pieces]).sum(axis=1))
    votes = np.bincount(
        matches.pieces, overlap * sense * lines.polarity[matches.lines], minlength=len(predicted)
    )
    shown = covered >= config.least_share
    look = np.flatnonzero(lengths >= config.lines.min_length_px)
    there = _at_place(projector, fit, lines)
    piece, line = _elsewhere(projector, fit, lines, shown, config)
    off, sigma, pull = _measured(projector, fit, lines, piece, line)
    rows = np.concatenate([predicted.rows[matches.pieces], predicted.rows[piece]])
    return Sightings(
        frames=np.full(len(look), frame),
        rows=predicted.rows[look],
        lengths_px=lengths[look],
        covered=covered[look],
        brighter=np.where(shown, np.sign(votes), 0.0)[look],
        line_frames=np.full(len(rows), frame),
        line_rows=rows,
        off_px=np.concatenate([there[0], off]),
        sigma_px=np.concatenate([there[1], sigma]),
        pull=np.concatenate([there[2], pull]),
        at_place=np.arange(len(rows)) < len(matches),
    )


def _fitted(
    projector: Projector, pose: Pose2, lines: LineMeasurements, config: SightingConfig
) -> _Fit | None:
    """Match and estimate in turn; None where little fits, or somewhere else."""
    camera, every = projector.camera, np.arange(len(projector.wire_map))
    here, state = pose, np.r_[pose.as_array(), np.zeros(7)]
    for pose_px in config.pose_px:
        predicted = projector.predict(here, every)
        map_px = map_deviations_px(projector, predicted)
        # Which side is brighter is what is to be learnt.
        matches = associate(predicted, lines, pose_px, map_px, np.zeros(len(predicted)))
        if len(np.unique(predicted.rows[matches.pieces])) < config.least_segments:
            return None
        seen = _observed(projector, predicted, lines, matches.pieces, matches.lines)
        estimate = estimate_pose(here, camera, seen)
        here, state = estimate.pose, estimate.state
    away = here.minus(pose)
    if math.hypot(away[0], away[1]) > config.astray_m or abs(away[2]) > config.astray_rad:
        return None
    _, jacobian = distances_and_jacobian(state, camera, seen)
    slopes = _middle_and_slope(jacobian) / np.stack([seen.sigma_middle_px, seen.sigma_slope_px], 1)[..., None]
    slopes = slopes.reshape(-1, slopes.shape[-1])
    information = slopes.T @ slopes + np.diag(np.r_[np.full(3, 1e-4), nuisance_information(camera)])
    return _Fit(state, predicted, matches, information)


def _at_place(projector: Projector, fit: _Fit, lines: LineMeasurements) -> tuple[Array, Array, Array]:
    """Distances (K,) of the matched lines from their edges as all other edges place them, deviations, pulls.

    At the optimum the pull of one edge's lines balances that of all others: without them, the estimate moves by
    (A - A_s)^-1 J_s^T W_s r_s.
    """
    matches = fit.matches
    seen = _observed(projector, fit.predicted, lines, matches.pieces, matches.lines)
    distances, jacobian = distances_and_jacobian(fit.state, projector.camera, seen)
    residual, slopes = _middle_and_slope(distances), _middle_and_slope(jacobian)
    sigma = np.stack([seen.sigma_middle_px, seen.sigma_slope_px], axis=1)
    off, variance = residual[:, 0].copy(), lines.sigma_middle_px[matches.lines] ** 2
    rows = fit.predicted.rows[matches.pieces]
    for row in np.unique(rows):
        own = np.flatnonzero(rows == row)
        whitened = (slopes[own] / sigma[own][..., None]).reshape(-1, slopes.shape[-1])
        others = np.linalg.inv(fit.information - whitened.T @ whitened)
        step = others @ whitened.T @ (residual[own] / sigma[own]).ravel()
        off[own] += slopes[own, 0] @ step
        variance[own] += np.einsum("ki,ij,kj->k", slopes[own, 0], others, slopes[own, 0])
    return off, np.sqrt(variance), -slopes[:, 0][:, _PLACE]


def _elsewhere(
    projector: Projector,
    fit: _Fit,
    lines: LineMeasurements,
    shown: NDArray[np.bool_],
    config: SightingConfig,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pieces that do not show, and lines beside them that no edge claims: (S,) and (S,)."""
    predicted = fit.predicted
    way = (predicted.ideal_px[:, 1] - predicted.ideal_px[:, 0]) / predicted.lengths_px[:, None]
    middle = lines.ends_px.mean(axis=1)
    off = middle @ predicted.normals[:, :2].T + predicted.normals[:, 2] * projector.camera.focal_px
    reach = projector.camera.focal_px * config.search_m / predicted.depths_m.mean(axis=1)
    parallel = np.abs(lines.along @ way.T) >= math.cos(config.search_rad)
    spans = np.sort(np.einsum("mei,pi->mpe", lines.ends_px, way), axis=2)
    spans -= (predicted.ideal_px[:, 0] * way).sum(axis=1)[:, None]
    shared = np.minimum(spans[..., 1], predicted.lengths_px) - np.maximum(spans[..., 0], 0.0)
    beside = shared >= config.least_beside * np.maximum(predicted.lengths_px, lines.lengths_px[:, None])
    long = predicted.lengths_px >= config.lines.min_length_px
    near = parallel & beside & (np.abs(off) <= reach) & long & ~shown
    near[fit.matches.lines] = False
    line, piece = np.nonzero(near)
    return piece, line


def _measured(
    projector: Projector,
    fit: _Fit,
    lines: LineMeasurements,
    piece: NDArray[np.int64],
    line: NDArray[np.int64],
) -> tuple[Array, Array, Array]:
    """Distances (S,) of lines from edges that the estimate did not use, deviations (S,) and pulls (S, 3)."""
    seen = _observed(projector, fit.predicted, lines, piece, line)
    distances, jacobian = distances_and_jacobian(fit.state, projector.camera, seen)
    slopes = _middle_and_slope(jacobian)[:, 0]
    covariance = np.linalg.inv(fit.information)
    variance = np.einsum("ki,ij,kj->k", slopes, covariance, slopes) + lines.sigma_middle_px[line] ** 2
    return _middle_and_slope(distances)[:, 0], np.sqrt(variance), -slopes[:, _PLACE]


def _observed(
    projector: Projector,
    predicted: Prediction,
    lines: LineMeasurements,
    piece: NDArray[np.int64],
    line: NDArray[np.int64],
) -> LineObservations:
    """Pairs of pieces and lines, (K,) each, as the estimator takes them."""
    rows, map_px = predicted.rows[piece], map_deviations_px(projector, predicted)[piece]
    return LineObservations(
        moments=projector.moments[rows],
        directions=projector.directions[rows],
        rays=lines.rays[line],
        sigma_middle_px=np.hypot(lines.sigma_middle_px[line], map_px),
        sigma_slope_px=np.hypot(lines.sigma_slope_px[line], map_px),
    )


def _middle_and_slope(ends: Array) -> Array:
    """Turn values at two ends, (K, 2, ...), into their half sum and half difference, (K, 2, ...)."""
    return np.stack([ends[:, 0] + ends[:, 1], ends[:, 1] - ends[:, 0]], axis=1) * 0.5
