"""The matcher: one image and a search window in; a fix, several poses, or the reason for none out."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import Look, NoFix, Outcome, PoseBelief, Reason, SearchWindow
from maps.poses import Array, Pose2
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import unary_correspondences
from vision.decision import DecisionConfig, decide
from vision.globalsearch import GlobalConfig, floor_hypotheses, floor_views
from vision.hypotheses import HypothesisConfig, couple_hypotheses, grid_hypotheses, spaced
from vision.images import GreyImage
from vision.linefield import FieldConfig, field_scores, line_field
from vision.lines import ImageSegments, LineConfig, extract_segments
from vision.lookalikes import with_lookalikes
from vision.measurements import measured_lines
from vision.projection import Prediction, Projector
from vision.refinement import Candidate, RefinementConfig, Scene, refine_poses
from vision.viewpoints import Viewpoints, viewpoints_in

#: How far edges are, for how much a step of the robot may bring into the image.
_TYPICAL_RANGE_M = 2.0
#: Poses look alike until edges this far away have moved by so many gates.
_FAR_M, _APART_GATES = 4.0, 3.0
#: A refined pose may leave its window by this; the regions of a window are asked for as much more.
_MARGIN_M = 0.1


@dataclass(frozen=True, slots=True)
class MatcherConfig:
    """What the matcher tries, and when it believes what it found."""

    lines: LineConfig = field(default_factory=LineConfig)
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    coarse: FieldConfig = field(default_factory=FieldConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    #: Where nothing but the image says where the robot is, it must say so more clearly.
    lost: DecisionConfig = field(
        default_factory=lambda: DecisionConfig(tried_weight=3.0, max_rival_odds=0.01)
    )
    #: A window wider than this in heading, to either side, is searched slice by slice.
    slice_rad: float = 0.6
    #: A window larger than this is searched over the whole floor, headings first.
    wide_m: float = 2.0
    floor: GlobalConfig = field(default_factory=GlobalConfig)
    #: Hypotheses that are refined, and how far apart they must be to count as different.
    refined: int = 8
    #: While tracking, in a window this small, few of them suffice: all lie near the truth.
    near_m: float = 0.2
    near_rad: float = math.radians(4.0)
    refined_near: int = 5
    apart_m: float = 0.05
    apart_rad: float = 0.01

    @classmethod
    def for_stated_noise(cls) -> MatcherConfig:
        """Return the parameters for lines whose noise is Gaussian, independent and as stated: drawn ones.

        Real edges are none of that: the defaults allow for neighbours taken for the right edge, for looks at one edge
        that are not independent, and for maps that are better or worse than they say.
        """
        decision = DecisionConfig(
            min_score=5.0, tried_weight=1.0, min_matched=3, score_temper=1.0, max_rival_odds=0.01
        )
        return cls(
            refinement=RefinementConfig(edge_model_px=0.0, student=30.0, spread_limits=(1.0, 1.0)),
            decision=decision,
            lost=decision,
            # A handful of lines says little about the heading: all of them are tried.
            floor=GlobalConfig(votes_share=0.0, kept=600, refined=60),
        )


class LineMatcher:
    """Finds the pose of one camera against one map; keeps nothing from image to image but timings,
    and what can be seen from where once it had to search everywhere.

    `regions`: of the map, at the camera's height; without them every segment is considered everywhere.
    """

    def __init__(
        self,
        camera: Camera,
        wire_map: WireMap,
        config: MatcherConfig | None = None,
        regions: ViewRegions | None = None,
    ) -> None:
        self.camera, self.wire_map, self.regions = camera, wire_map, regions
        self.config = config or MatcherConfig()
        self.projector = Projector(camera, wire_map)
        self._floor_views: Viewpoints | None = None
        #: Milliseconds that the last image took: "extract" and "match".
        self.timing_ms: dict[str, float] = {"extract": 0.0, "match": 0.0}

    def match(self, image: GreyImage, stamp_ns: int, window: SearchWindow) -> Outcome:
        """Match one grey image (H, W) inside a window."""
        started = time.perf_counter()
        segments = extract_segments(image, self.camera, self.config.lines)
        extracted = time.perf_counter()
        outcome = self.match_segments(segments, stamp_ns, window)
        matched = time.perf_counter()
        self.timing_ms = {"extract": 1e3 * (extracted - started), "match": 1e3 * (matched - extracted)}
        return outcome

    def match_segments(self, segments: ImageSegments, stamp_ns: int, window: SearchWindow) -> Outcome:
        """Match extracted segments inside a window: the paper's chain, from selection to verification."""
        look = Look(lines_px=segments.raw_px, polarity=segments.polarity)
        if len(segments) < self.config.decision.min_matched:
            return NoFix(Reason.TOO_FEW_SEGMENTS, look)
        wide = window.dt_m > self.config.wide_m
        search = self._search_floor if wide else self._search_window
        rows, look, hypotheses, scores = search(segments, window, look)
        if look.selected < self.config.decision.min_matched:
            return NoFix(Reason.NOTHING_VISIBLE, look)
        starts = self._best_that_differ(hypotheses, scores, self._refined(window))
        look = replace(look, hypotheses=len(hypotheses), refined=len(starts))
        lines = measured_lines(segments, self.camera.focal_px, self.config.refinement.edge_model_px)
        scene = Scene(self.projector, rows, lines)
        refined = refine_poses(scene, starts, stamp_ns, self.config.refinement)
        if wide:
            refined = with_lookalikes(scene, refined, stamp_ns, self.config.refinement)
        candidates = [candidate for candidate in refined if _may_lie_in(window, candidate.belief)]
        if not candidates:
            return NoFix(Reason.NO_HYPOTHESIS, look)
        look = self._looked_at(candidates[0], look)
        tried = self._different_poses(window, candidates[0])
        return decide(candidates, look, tried, self.config.lost if wide else self.config.decision)

    def _search_window(
        self, segments: ImageSegments, window: SearchWindow, look: Look
    ) -> tuple[NDArray[np.int64], Look, Array, Array]:
        """Hypotheses (H, 3) of a window and their support (H,), and the segments that can be seen from it."""
        rows = self._selected(window)
        slices = [(part, self._predicted(part, rows)) for part in self._slices(window)]
        predicted = slices[len(slices) // 2][1]
        look = replace(
            look,
            predicted_px=self._raw_pixels(predicted),
            predicted_map=predicted.rows,
            selected=len(np.unique(np.concatenate([seen.rows for _, seen in slices]))),
        )
        hypotheses = self._hypotheses(segments, window, slices)
        # What the centre sees stands for a small window.
        seen = rows if window.dt_m > self.config.near_m else np.unique(predicted.rows)
        viewpoints = viewpoints_in(self.projector, window, seen)
        spread_out = line_field(segments, self.projector, self.config.coarse.kernel_px)
        nearest = viewpoints.nearest(hypotheses)
        scores = field_scores(spread_out, self.projector, viewpoints, hypotheses, nearest, self.config.coarse)
        return rows, look, hypotheses, scores

    def _search_floor(
        self, segments: ImageSegments, window: SearchWindow, look: Look
    ) -> tuple[NDArray[np.int64], Look, Array, Array]:
        """The same over the whole floor, headings first; then what lies in the window."""
        rows = np.arange(len(self.wire_map))
        if self._floor_views is None:
            self._floor_views = floor_views(self.projector, self.regions, self.config.floor)
        poses, scores = floor_hypotheses(
            self.projector, segments, self._floor_views, self.config.coarse, self.config.floor
        )
        inside = window.held(poses)
        return rows, replace(look, selected=len(rows)), poses[inside], scores[inside]

    def _refined(self, window: SearchWindow) -> int:
        """How many hypotheses are worth refining."""
        if window.dt_m > self.config.wide_m:
            return self.config.floor.refined
        near = window.dt_m <= self.config.near_m and window.dphi_rad <= self.config.near_rad
        return min(self.config.refined_near, self.config.refined) if near else self.config.refined

    def _different_poses(self, window: SearchWindow, found: Candidate) -> float:
        """How many poses that an image can tell apart were as likely as the one found, at least one.

        Edges leave their gates between two such poses. In a disc all are alike; in a belief's ellipsoid there are
        more of them towards the rim.
        """
        apart_rad = _APART_GATES * found.gate_px / self.camera.focal_px
        apart_m = _FAR_M * apart_rad
        area = min(math.pi * window.dt_m**2, self.wire_map.floor.area)
        number = max(area / apart_m**2, 1.0) * max(2.0 * window.dphi_rad / apart_rad, 1.0)
        if window.ellipsoid is None:
            return number
        return max(min(number, window.ellipsoid.spread_at(found.belief) / (apart_m**2 * apart_rad)), 1.0)

    def _selected(self, window: SearchWindow) -> NDArray[np.int64]:
        """The segments that can be seen from somewhere in the window."""
        if self.regions is None:
            return np.arange(len(self.wire_map))
        centre = window.centre @ Pose2(
            self.camera.mount.x_m, self.camera.mount.y_m, self.camera.mount.yaw_rad
        )
        lever = math.hypot(self.camera.mount.x_m, self.camera.mount.y_m) * min(window.dphi_rad, 2.0)
        half_view = math.atan(np.abs(self.projector.bounds[:2]).max())
        return self.regions.visible(
            (centre.x, centre.y),
            window.dt_m + lever + _MARGIN_M,
            centre.phi,
            window.dphi_rad + half_view + 0.05,
        )

    def _hypotheses(
        self, segments: ImageSegments, window: SearchWindow, slices: list[tuple[SearchWindow, Prediction]]
    ) -> Array:
        """Poses (H, 3) of the window: those that couples of correspondences agree on, and a grid."""
        config = self.config.hypotheses
        couples = []
        longest = np.sort(np.argsort(-segments.lengths_px, kind="stable")[: config.max_lines])
        segments = segments[longest]
        for part, predicted in slices:
            pairs = unary_correspondences(self.camera, self.wire_map, segments, predicted, part)
            couples.append(couple_hypotheses(self.camera, pairs, part, config))
        return np.concatenate([*couples, grid_hypotheses(window, config)])

    def _slices(self, window: SearchWindow) -> list[SearchWindow]:
        """The window in an odd number of slices of heading, each predictable from its centre."""
        number = 2 * math.ceil((window.dphi_rad / self.config.slice_rad - 1.0) / 2.0) + 1
        if number <= 1:
            return [window]
        half = window.dphi_rad / number
        offsets = half * (2.0 * np.arange(number) - (number - 1))
        x, y, phi = window.centre.as_array()
        return [replace(window, centre=Pose2(x, y, phi + offset), dphi_rad=half) for offset in offsets]

    def _predicted(self, window: SearchWindow, rows: NDArray[np.int64]) -> Prediction:
        """The segments that may be seen from the window, as they appear from its centre."""
        margin = self.camera.focal_px * (math.tan(min(window.dphi_rad, 1.0)) + window.dt_m / _TYPICAL_RANGE_M)
        return self.projector.predict(window.centre, rows, margin)

    def _best_that_differ(self, poses: Array, scores: Array, number: int) -> list[Pose2]:
        """The best hypotheses by quick score, each at some distance from all better ones."""
        best_first = poses[np.argsort(-scores, kind="stable")]
        chosen = spaced(best_first, number, self.config.apart_m, self.config.apart_rad)
        return [Pose2.from_array(pose) for pose in best_first[chosen]]

    def _looked_at(self, candidate: Candidate, look: Look) -> Look:
        """The look with what the best candidate predicts and pairs."""
        predicted, matches = candidate.predicted, candidate.matches
        return replace(
            look,
            predicted_px=self._raw_pixels(predicted),
            predicted_map=predicted.rows,
            matched_map=predicted.rows[matches.pieces],
            matched_image=matches.lines,
            residuals_px=matches.rms_px,
            score=candidate.score,
        )

    def _raw_pixels(self, predicted: Prediction) -> Array:
        normalised = predicted.ideal_px.reshape(-1, 2) / self.camera.focal_px
        return self.camera.distort(normalised).reshape(-1, 2, 2)


def _may_lie_in(window: SearchWindow, belief: PoseBelief) -> bool:
    """Whether the belief's ellipse of three standard deviations reaches into the window."""
    away = belief.pose.minus(window.centre)
    near = (
        math.hypot(away[0], away[1]) <= window.dt_m + 3.0 * belief.position_std_m
        and abs(away[2]) <= window.dphi_rad + 3.0 * belief.heading_std_rad
    )
    return near and (window.ellipsoid is None or window.ellipsoid.may_hold(belief))
