"""From a rough pose to the best one nearby: match and estimate in turn, with shrinking gates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2
from vision.association import GATE_SIGMAS, Matches, associate
from vision.measurements import LineMeasurements
from vision.pose import LineObservations, PoseEstimate, estimate_pose, predicted_sigma_px, squared_innovations
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig, log_likelihood_ratio

#: Fewer different segments than this do not fix a planar pose.
_MIN_SEGMENTS = 3
#: Where geometry is so weak that an edge could be anywhere, this is still where it is looked for.
_MOST_SHIFT_PX = 10.0
#: Chi-square gate of 3 standard deviations, for offset and direction together.
_GATE_CHI2 = 11.83


@dataclass(frozen=True, slots=True)
class RefinementConfig:
    """How matching and estimation alternate."""

    #: How far the pose may still shift the picture, stage by stage: one standard deviation.
    pose_px: tuple[float, ...] = (4.0, 2.0, 1.3)
    #: After each stage, trials that pair less than this share of the most go no further.
    paired_share: tuple[float, ...] = (0.5, 0.6, 0.7)
    #: What the ends of a real edge are off the straight, sharp ideal, beside the image's noise: edges are rounded,
    #: unevenly lit and, under distortion, bent.
    edge_model_px: float = 0.5
    #: Degrees of freedom of the residuals' Student distribution: few where lines are mistaken for their neighbours.
    student: float = 3.0
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
class Trial:
    """A pose on its way; `spread` scales the noise by how well the lines fit so far.

    `deviations`: (7,) of the camera from what it should be, as estimated so far.
    """

    pose: Pose2
    deviations: Array | None = None
    spread: float = 1.0
    paired_px: float = 0.0
    estimate: PoseEstimate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What refinement works on: a map through a camera, the segments `rows` that may be visible, an image's lines."""

    projector: Projector
    rows: NDArray[np.int64]
    lines: LineMeasurements

    def matched(self, trial: Trial, pose_px: float) -> tuple[Prediction, Matches]:
        """Predict from a trial's pose, and pair what is predicted with the image's lines.

        `pose_px`: how far the pose may still shift the picture. Before the first estimate the camera may, too.
        """
        predicted = self.projector.predict(trial.pose, self.rows, deviations=trial.deviations)
        polarity = self.projector.wire_map.polarity[predicted.rows]
        place_px = trial.spread * self.map_px(predicted)
        if trial.estimate is None:
            pose_px = math.hypot(pose_px, self.projector.camera.shift_px)
            return predicted, associate(predicted, self.lines, pose_px, place_px, polarity)
        place_px = np.hypot(place_px, self.estimate_px(trial.estimate, predicted))
        matches = associate(predicted, self.lines, pose_px, place_px, polarity)
        seen = observations(self, predicted, matches, trial.spread, pose_px)
        innovations = squared_innovations(trial.estimate, self.projector.camera, seen)
        return predicted, matches[innovations <= _GATE_CHI2]

    def estimate_px(self, estimate: PoseEstimate, predicted: Prediction) -> Array:
        """Return how far an estimate's uncertainty may shift the predicted pieces, (P,), in pixels, within reason."""
        camera, count = self.projector.camera, len(predicted)
        rays = np.concatenate([predicted.ideal_px, np.full((count, 2, 1), camera.focal_px)], axis=2)
        moments, directions = (
            self.projector.moments[predicted.rows],
            self.projector.directions[predicted.rows],
        )
        drawn = LineObservations(moments, directions, rays, np.ones(count), np.ones(count))
        return np.minimum(predicted_sigma_px(estimate, camera, drawn), _MOST_SHIFT_PX)

    def map_px(self, predicted: Prediction) -> Array:
        """Return what the map's uncertainty makes in the image, one standard deviation, pixels (P,)."""
        sigma = self.projector.wire_map.sigma_m[predicted.rows]
        result: Array = 2.0 * self.projector.camera.focal_px * sigma / predicted.depths_m.sum(axis=1)
        return result


def refine_poses(
    scene: Scene, starts: list[Pose2], stamp_ns: int, config: RefinementConfig
) -> list[Candidate]:
    """Return the optima near the starts, best first; starts that run out of matches or meet drop out."""
    trials = [Trial(start) for start in starts]
    for pose_px, share in zip(config.pose_px, config.paired_share, strict=True):
        improved = [_improve(scene, trial, pose_px, config) for trial in trials]
        trials = _distinct([trial for trial in improved if trial is not None], config)
        most = max((trial.paired_px for trial in trials), default=0.0)
        trials = [trial for trial in trials if trial.paired_px >= share * most]
    candidates = (_judge(scene, trial, stamp_ns, config) for trial in trials)
    return sorted(candidates, key=lambda candidate: -candidate.score)


def _improve(scene: Scene, trial: Trial, pose_px: float, config: RefinementConfig) -> Trial | None:
    """Match and estimate once; None where too little matches."""
    predicted, matches = scene.matched(trial, pose_px)
    if len(set(predicted.rows[matches.pieces].tolist())) < _MIN_SEGMENTS:
        return None
    seen = observations(scene, predicted, matches, trial.spread)
    camera = scene.projector.camera
    estimate = estimate_pose(trial.pose, camera, seen, config.student, deviations=trial.deviations)
    spread = min(max(trial.spread * estimate.spread, config.spread_limits[0]), config.spread_limits[1])
    return Trial(
        estimate.pose,
        estimate.state[3:],
        spread,
        float(scene.lines.lengths_px[matches.lines].sum()),
        estimate,
    )


def _judge(scene: Scene, trial: Trial, stamp_ns: int, config: RefinementConfig) -> Candidate:
    """Weigh a refined pose by all that should be seen from it."""
    assert trial.estimate is not None
    predicted, matches = scene.matched(trial, config.pose_px[-1])
    sigma = observations(scene, predicted, matches, trial.spread).sigma_middle_px
    lines, camera = scene.lines, scene.projector.camera
    line_px = float(np.median(lines.sigma_middle_px))
    map_px = trial.spread * scene.map_px(predicted)
    gates = GATE_SIGMAS * np.sqrt(map_px**2 + config.pose_px[-1] ** 2 + line_px**2)
    score = log_likelihood_ratio(
        predicted,
        matches,
        lines,
        scene.projector.wire_map.detection_rate[predicted.rows],
        gates,
        sigma,
        float(camera.width * camera.height),
        config.student,
        config.evidence,
    )
    return Candidate(PoseBelief(stamp_ns, trial.pose, trial.estimate.covariance), predicted, matches, score)


def observations(
    scene: Scene, predicted: Prediction, matches: Matches, spread: float = 1.0, pose_px: float = 0.0
) -> LineObservations:
    """Return the matched pairs as the estimator weighs them: image noise, and the map's own uncertainty.

    `spread` scales both: a map that fits the image better than it promised is believed. `pose_px`: what else may
    shift the picture.
    """
    projector, lines = scene.projector, scene.lines
    rows = predicted.rows[matches.pieces]
    # The fragments of one segment share the error of its place in the map.
    fragments = np.bincount(matches.pieces, minlength=len(predicted))[matches.pieces]
    map_px = scene.map_px(predicted)[matches.pieces] * np.sqrt(fragments)
    share = lines.lengths_px[matches.lines] / predicted.lengths_px[matches.pieces]
    map_slope_px = map_px * np.minimum(share, 1.0)
    return LineObservations(
        moments=projector.moments[rows],
        directions=projector.directions[rows],
        rays=lines.rays[matches.lines],
        sigma_middle_px=np.hypot(pose_px, spread * np.hypot(lines.sigma_middle_px[matches.lines], map_px)),
        sigma_slope_px=np.hypot(
            pose_px, spread * np.hypot(lines.sigma_slope_px[matches.lines], map_slope_px)
        ),
    )


def _distinct(trials: list[Trial], config: RefinementConfig) -> list[Trial]:
    """The trials without those that have met an earlier one."""
    kept: list[Trial] = []
    for trial in trials:
        away: list[Array] = [np.abs(trial.pose.minus(other.pose)) for other in kept]
        if not any(math.hypot(a[0], a[1]) < config.same_m and a[2] < config.same_rad for a in away):
            kept.append(trial)
    return kept
