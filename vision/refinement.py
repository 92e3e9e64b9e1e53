"""From a rough pose to the best one nearby: match and estimate in turn, with shrinking gates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2
from vision.accidents import accidental_share, credence
from vision.association import GATE_SIGMAS, Matches, associate
from vision.measurements import LineMeasurements
from vision.pose import PoseEstimate, estimate_pose, predicted_sigma_px, squared_innovations
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig, log_likelihood_ratio
from vision.weighing import map_deviations_px, observations

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
    #: So many lines it takes to say it as loudly as the map and the extraction do.
    spread_prior: float = 8.0
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
    #: Median half width of the gates about what is predicted: how sharply the image was compared.
    gate_px: float

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
class View:
    """What a trial predicts, and the image's lines paired with it.

    `map_px`: (P,) what the map's uncertainty makes of each predicted piece, one standard deviation.
    """

    predicted: Prediction
    matches: Matches
    map_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What refinement works on: a map through a camera, the segments `rows` that may be visible, an image's lines."""

    projector: Projector
    rows: NDArray[np.int64]
    lines: LineMeasurements

    def view(self, trial: Trial, pose_px: float) -> View:
        """Predict from a trial's pose, and pair what is predicted with the image's lines.

        `pose_px`: how far the pose may still shift the picture. Before the first estimate the camera may, too.
        """
        projector, lines = self.projector, self.lines
        predicted = projector.predict(trial.pose, self.rows, deviations=trial.deviations)
        polarity = projector.wire_map.polarity[predicted.rows]
        map_px = map_deviations_px(projector, predicted)
        place_px = trial.spread * map_px
        if trial.estimate is None:
            pose_px = math.hypot(pose_px, projector.camera.shift_px)
            return View(predicted, associate(predicted, lines, pose_px, place_px, polarity), map_px)
        place_px = np.hypot(place_px, self.estimate_px(trial.estimate, predicted))
        matches = associate(predicted, lines, pose_px, place_px, polarity)
        seen = observations(projector, lines, predicted, matches, map_px, trial.spread, pose_px)
        innovations = squared_innovations(trial.estimate, projector.camera, seen)
        return View(predicted, matches[innovations <= _GATE_CHI2], map_px)

    def estimate_px(self, estimate: PoseEstimate, predicted: Prediction) -> Array:
        """Return how far an estimate's uncertainty may shift the predicted pieces, (P,), in pixels, within reason."""
        camera, rows = self.projector.camera, predicted.rows
        rays = np.full((len(predicted), 2, 3), camera.focal_px)
        rays[:, :, :2] = predicted.ideal_px
        drawn = (self.projector.moments[rows], self.projector.directions[rows], rays)
        return np.minimum(predicted_sigma_px(estimate, camera, *drawn), _MOST_SHIFT_PX)

    def gates_px(self, view: View, spread: float, config: RefinementConfig) -> Array:
        """Return how far off a line may at last lie from its piece, (P,)."""
        least = math.hypot(config.pose_px[-1], self.lines.typical_px)
        result: Array = GATE_SIGMAS * np.hypot(least, spread * view.map_px)
        return result

    def rates(self, view: View, config: RefinementConfig) -> Array:
        """Return how often each predicted piece shows in an image, (P,)."""
        return config.evidence.rates(self.projector.wire_map.detection_rate[view.predicted.rows])

    def credence(self, view: View, trial: Trial, pose_px: float, config: RefinementConfig) -> Array:
        """Return how likely each pair is right, (K,): in wide gates among many lines, not very."""
        gates, pieces = self.gates_px(view, trial.spread, config), view.matches.pieces
        if trial.estimate is None:
            pose_px = math.hypot(pose_px, self.projector.camera.shift_px)
        accidents = accidental_share(view.predicted, self.lines, gates, self.projector.camera.area_px)
        return credence(
            view.matches,
            np.hypot(pose_px, gates[pieces] / GATE_SIGMAS),
            self.rates(view, config)[pieces],
            (accidents / (2.0 * gates))[pieces],
            config.student,
        )


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
    judged = (_judge(scene, trial, stamp_ns, config) for trial in trials)
    candidates = [candidate for candidate in judged if candidate is not None]
    return sorted(candidates, key=lambda candidate: -candidate.score)


def _improve(scene: Scene, trial: Trial, pose_px: float, config: RefinementConfig) -> Trial | None:
    """Match and estimate once; None where too little matches."""
    view = scene.view(trial, pose_px)
    predicted, matches, lines = view.predicted, view.matches, scene.lines
    if len(set(predicted.rows[matches.pieces].tolist())) < _MIN_SEGMENTS:
        return None
    credence = scene.credence(view, trial, pose_px, config)
    seen = observations(
        scene.projector, lines, predicted, matches, view.map_px, trial.spread, credence=credence
    )
    camera = scene.projector.camera
    estimate = estimate_pose(trial.pose, camera, seen, config.student, deviations=trial.deviations)
    spread = _believed_spread(trial.spread * estimate.spread, len(matches), config)
    return Trial(
        estimate.pose,
        estimate.state[3:],
        spread,
        float(lines.lengths_px[matches.lines].sum()),
        estimate,
    )


def _believed_spread(measured: float, lines: int, config: RefinementConfig) -> float:
    """The spread after so many lines, within limits: the mean of a scaled inverse chi-square posterior."""
    prior, (low, high) = config.spread_prior, config.spread_limits
    believed = math.sqrt((prior + lines * measured**2) / (prior + lines))
    return min(max(believed, low), high)


def _judge(scene: Scene, trial: Trial, stamp_ns: int, config: RefinementConfig) -> Candidate | None:
    """Weigh a refined pose by all that should be seen from it; None where that is nothing."""
    assert trial.estimate is not None
    view = scene.view(trial, config.pose_px[-1])
    predicted, matches, lines = view.predicted, view.matches, scene.lines
    if not len(predicted):
        return None
    seen = observations(scene.projector, lines, predicted, matches, view.map_px, trial.spread)
    gates = scene.gates_px(view, trial.spread, config)
    score = log_likelihood_ratio(
        predicted,
        matches,
        lines,
        scene.rates(view, config),
        gates,
        seen.sigma_middle_px,
        scene.projector.camera.area_px,
        config.student,
        config.evidence,
    )
    belief = PoseBelief(stamp_ns, trial.pose, trial.estimate.covariance)
    return Candidate(belief, predicted, matches, score, float(np.median(gates)))


def _distinct(trials: list[Trial], config: RefinementConfig) -> list[Trial]:
    """The trials without those that have met an earlier one."""
    kept: list[Trial] = []
    for trial in trials:
        away: list[Array] = [np.abs(trial.pose.minus(other.pose)) for other in kept]
        if not any(math.hypot(a[0], a[1]) < config.same_m and a[2] < config.same_rad for a in away):
            kept.append(trial)
    return kept
