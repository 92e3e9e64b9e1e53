"""From a rough pose to the best one nearby: match and estimate in turn, with shrinking gates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2
from vision.association import Matches, associate
from vision.lines import ImageSegments
from vision.pose import LineObservations, PoseEstimate, estimate_pose
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig, log_likelihood_ratio

#: Fewer different segments than this do not fix a planar pose.
_MIN_SEGMENTS = 3


@dataclass(frozen=True, slots=True)
class RefinementConfig:
    """How matching and estimation alternate."""

    #: Largest distance of a line from its predicted segment, stage by stage.
    gates_px: tuple[float, ...] = (12.0, 6.0, 4.0)
    #: How much better or worse than promised, as a factor, lines may turn out to fit.
    spread_limits: tuple[float, float] = (0.3, 1.5)
    #: Optima nearer than this to a better one are the same.
    same_m: float = 0.005
    same_rad: float = 0.002
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A refined pose with what supports it."""

    belief: PoseBelief
    predicted: Prediction
    matches: Matches
    score: float

    @property
    def matched_segments(self) -> int:
        """How many different map segments are matched."""
        return len(np.unique(self.predicted.rows[self.matches.pieces]))


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """A pose on its way; `spread` scales the noise by how well the lines fit so far."""

    pose: Pose2
    spread: float = 1.0
    estimate: PoseEstimate | None = None


def refine_poses(
    projector: Projector,
    starts: list[Pose2],
    rows: NDArray[np.int64],
    segments: ImageSegments,
    stamp_ns: int,
    config: RefinementConfig,
) -> list[Candidate]:
    """Return the optima near the starts, best first; starts that run out of matches or meet drop out.

    `rows`: the map segments that may be visible.
    """
    trials = [_Trial(start) for start in starts]
    for gate in config.gates_px:
        improved = (_improve(projector, trial, rows, segments, gate, config) for trial in trials)
        trials = _distinct([trial for trial in improved if trial is not None], config)
    gate = config.gates_px[-1]
    candidates = (_judge(projector, trial, rows, segments, stamp_ns, gate, config) for trial in trials)
    return sorted(candidates, key=lambda candidate: -candidate.score)


def _improve(
    projector: Projector,
    trial: _Trial,
    rows: NDArray[np.int64],
    segments: ImageSegments,
    gate_px: float,
    config: RefinementConfig,
) -> _Trial | None:
    """Match within the gate and estimate once; None where too little matches."""
    predicted = projector.predict(trial.pose, rows)
    matches = associate(projector.camera, predicted, segments, gate_px)
    if len(np.unique(predicted.rows[matches.pieces])) < _MIN_SEGMENTS:
        return None
    seen = observations(projector, predicted, matches, segments, trial.spread)
    estimate = estimate_pose(trial.pose, projector.camera, seen)
    spread = float(np.clip(trial.spread * estimate.spread, *config.spread_limits))
    return _Trial(estimate.pose, spread, estimate)


def _judge(
    projector: Projector,
    trial: _Trial,
    rows: NDArray[np.int64],
    segments: ImageSegments,
    stamp_ns: int,
    gate_px: float,
    config: RefinementConfig,
) -> Candidate:
    """Weigh a refined pose by all that should be seen from it."""
    assert trial.estimate is not None
    predicted = projector.predict(trial.pose, rows)
    matches = associate(projector.camera, predicted, segments, gate_px)
    sigma = observations(projector, predicted, matches, segments, trial.spread).sigma_middle_px
    score = log_likelihood_ratio(
        projector.wire_map, predicted, matches, segments, projector.camera, gate_px, sigma, config.evidence
    )
    return Candidate(PoseBelief(stamp_ns, trial.pose, trial.estimate.covariance), predicted, matches, score)


def observations(
    projector: Projector, predicted: Prediction, matches: Matches, segments: ImageSegments, spread: float
) -> LineObservations:
    """Return the matched pairs as the estimator weighs them: image noise, and the map's own uncertainty.

    `spread` scales both: a map that fits the image better than it promised is believed.
    """
    camera, wire_map = projector.camera, projector.wire_map
    rows = predicted.rows[matches.pieces]
    ends = wire_map.endpoints[rows]
    direction = ends[:, 1] - ends[:, 0]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    focal = np.full((len(matches), 2, 1), camera.focal_px)
    depth = predicted.depths_m[matches.pieces].mean(axis=1)
    # The fragments of one segment share the error of its place in the map.
    fragments = np.bincount(matches.pieces, minlength=len(predicted))[matches.pieces]
    map_px = camera.focal_px * wire_map.sigma_m[rows] / depth * np.sqrt(fragments)
    line_px = segments.sigma_px[matches.lines] / math.sqrt(2.0)
    share = segments.lengths_px[matches.lines] / predicted.lengths_px[matches.pieces]
    return LineObservations(
        moments=np.cross(ends[:, 0], direction),
        directions=direction,
        rays=np.concatenate([segments.ideal_px[matches.lines], focal], axis=2),
        sigma_middle_px=spread * np.hypot(line_px, map_px),
        sigma_slope_px=spread * np.hypot(line_px, map_px * np.minimum(share, 1.0)),
    )


def _distinct(trials: list[_Trial], config: RefinementConfig) -> list[_Trial]:
    """The trials without those that have met an earlier one."""
    kept: list[_Trial] = []
    for trial in trials:
        away: list[Array] = [np.abs(trial.pose.minus(other.pose)) for other in kept]
        if not any(math.hypot(a[0], a[1]) < config.same_m and a[2] < config.same_rad for a in away):
            kept.append(trial)
    return kept
