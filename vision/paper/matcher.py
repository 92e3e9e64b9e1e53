"""The paper's matcher, from image and window to an outcome: figure 10, one stage a line."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import Fix, Look, NoFix, Outcome, PoseBelief, Reason, SearchWindow
from maps.poses import Array
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.images import GreyImage
from vision.lines import ImageSegments, LineConfig, extract_segments
from vision.paper.binary import VerticalPairs, binary_constraint
from vision.paper.combinations import HypothesisList, combine
from vision.paper.covariance import pose_covariance, robot_pose
from vision.paper.distance import SegmentDistance
from vision.paper.errors import Bearings, LineErrors, bearings_of, line_errors
from vision.paper.interpretation import Interpretation
from vision.paper.leastsquares import equations
from vision.paper.order import order_of_appearance
from vision.paper.selection import ViewedDisc, exact_regions, select_segments, viewed_disc
from vision.paper.tablecache import cached_table
from vision.paper.tables import TableConfig, ToleranceTable
from vision.paper.trees import Combinations, horizontal_tree, vertical_tree
from vision.paper.unary import sector_fits, unary_constraint
from vision.paper.verification import (
    PairList,
    Verdicts,
    Winner,
    all_pairs,
    inside,
    line_residuals,
    members,
    verify,
)
from vision.paper.verticals import VerticalRule, vertical_lines
from vision.projection import Prediction, Projector


class ToleranceMethod(StrEnum):
    """Where the constraints' tolerances come from."""

    #: The lines' own errors, propagated.
    ANALYTIC = "analytic"
    #: Section 3.4: tables made beforehand by Monte Carlo for one noise (`TableConfig`).
    MONTE_CARLO = "monte_carlo"


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """What the paper leaves open, in the reading taken, and the limits that it does not have."""

    lines: LineConfig = field(default_factory=LineConfig)
    #: Standard deviations that a constraint allows for noise; 2 keep a right pair with 95.4 %.
    sigmas: float = 2.0
    tolerances: ToleranceMethod = ToleranceMethod.ANALYTIC
    table: TableConfig = field(default_factory=TableConfig)
    vertical_rule: VerticalRule = VerticalRule.VANISHING_POINT
    #: Test vertical pairs one by one, too, by the bearings that the window allows; not in the paper.
    vertical_sector: bool = False
    #: k: fewest correspondences of a hypothesis, and which of its distances is its score.
    least: int = 4
    #: The same as a share of the edges predicted at the window's centre, if that is more.
    least_share: float = 0.0
    distance: SegmentDistance = SegmentDistance.MEAN
    #: Whether a pose outside the window is thrown away; the paper does not say.
    inside_window: bool = False
    #: Limits: hypotheses evaluated, combinations of either tree, vertical pairs (whose couples are tested).
    budget: int = 500_000
    max_combinations: int = 200_000
    max_vertical_pairs: int = 3_000


class PaperMatcher:
    """Finds the pose of one camera against one map as the paper does; same interface as the default matcher."""

    def __init__(
        self,
        camera: Camera,
        wire_map: WireMap,
        regions: ViewRegions | None = None,
        config: PaperConfig | None = None,
    ) -> None:
        self.camera, self.wire_map = camera, wire_map
        self.config = config or PaperConfig()
        self.regions = exact_regions(wire_map, camera.mount.height_m) if regions is None else regions
        self.projector = Projector(camera, wire_map)
        self.table: ToleranceTable | None = None
        if self.config.tolerances is ToleranceMethod.MONTE_CARLO:
            self.table = cached_table(camera, wire_map, self.config.table)
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
        """Match extracted segments inside a window; what came of each stage is told by `interpret`."""
        return self.outcome(segments, self.interpret(segments, window), stamp_ns, window)

    def interpret(self, segments: ImageSegments, window: SearchWindow) -> Interpretation:
        """Run all stages of figure 10 and return what each gave."""
        config, camera, wire_map, clock = self.config, self.camera, self.wire_map, _Clock()
        disc = viewed_disc(camera, window)
        selection = select_segments(camera, wire_map, self.regions, window)
        clock.lap("selection")
        errors, bearings = line_errors(camera, segments), bearings_of(camera, segments)
        lv = vertical_lines(camera, segments, errors, config.sigmas, config.vertical_rule)
        clock.lap("division")
        unary = unary_constraint(camera, wire_map, errors, selection.other, disc, config.sigmas, self.table)
        clock.lap("unary")
        verticals = self._couples(selection.vertical, lv, bearings, disc)
        clock.lap("binary")
        order = order_of_appearance(wire_map, self.regions, selection.regions, selection.vertical)
        clock.lap("order")
        horizontal = horizontal_tree(unary, config.max_combinations)
        vertical = vertical_tree(verticals, order, selection.vertical, config.max_combinations)
        clock.lap("trees")
        least = self._least(selection.rows, window)
        hypotheses = combine(horizontal, unary.lines, vertical, verticals.lines, least, config.budget)
        clock.lap("product")
        pairs = all_pairs(unary, verticals)
        verdicts = self._verdicts(segments, errors, pairs, (horizontal, vertical), hypotheses, window, least)
        winner = self._winner(errors, pairs, (horizontal, vertical), hypotheses, verdicts)
        clock.lap("verification")
        return Interpretation(
            selection=selection,
            lines=len(segments),
            vertical_lines=lv,
            unary=unary,
            verticals=verticals,
            horizontal_list=horizontal,
            vertical_list=vertical,
            hypotheses=hypotheses,
            verdicts=verdicts,
            least=least,
            winner=winner,
            stage_ms=clock.stage_ms,
        )

    def outcome(
        self, segments: ImageSegments, found: Interpretation, stamp_ns: int, window: SearchWindow
    ) -> Outcome:
        """Return an interpretation as every matcher tells it; the paper never says that an image is ambiguous."""
        winner = found.winner
        pose = window.centre if winner is None else winner.pose
        predicted = self.projector.predict(pose, found.selection.rows)
        look = Look(
            lines_px=segments.raw_px,
            polarity=segments.polarity,
            predicted_px=self._raw_pixels(predicted),
            predicted_map=predicted.rows,
            selected=len(found.selection.rows),
            hypotheses=len(found.hypotheses),
        )
        if winner is None:
            return NoFix(self._reason(found), look)
        look = replace(
            look,
            matched_map=winner.rows,
            matched_image=winner.lines,
            residuals_px=line_residuals(self.camera, self.wire_map, segments, winner),
            score=-winner.score_px,
        )
        if winner.covariance is None:
            return NoFix(Reason.WEAK_GEOMETRY, look)
        return Fix(PoseBelief(stamp_ns, winner.pose, winner.covariance), look)

    def _couples(
        self, edges: NDArray[np.int64], lv: NDArray[np.int64], bearings: Bearings, disc: ViewedDisc
    ) -> VerticalPairs:
        """Couples of L_v and couples of l_v through the binary constraint."""
        config, wire_map = self.config, self.wire_map
        fits = np.ones((len(edges), len(lv)), bool)
        if config.vertical_sector:
            points, blur = wire_map.endpoints[edges].mean(axis=1)[:, :2], wire_map.sigma_m[edges]
            fits = sector_fits(bearings, lv, points, blur, disc, config.sigmas)
        edge, line = np.nonzero(fits)
        dropped = max(len(edge) - config.max_vertical_pairs, 0)
        kept = slice(len(edge) - dropped)
        rows, lines = edges[edge[kept]], lv[line[kept]]
        return binary_constraint(
            wire_map, bearings, rows, lines, disc, config.sigmas, self.table, dropped=dropped
        )

    def _least(self, rows: NDArray[np.int64], window: SearchWindow) -> int:
        """k: a number, or a share of the edges that should be viewed."""
        least = self.config.least
        if self.config.least_share > 0.0:
            viewed = len(np.unique(self.projector.predict(window.centre, rows).rows))
            least = max(least, math.ceil(self.config.least_share * viewed))
        return least

    def _verdicts(
        self,
        segments: ImageSegments,
        errors: LineErrors,
        pairs: PairList,
        lists: tuple[Combinations, Combinations],
        hypotheses: HypothesisList,
        window: SearchWindow,
        least: int,
    ) -> Verdicts:
        system = equations(self.camera, self.wire_map, errors, pairs.rows, pairs.lines)
        verdicts = verify(
            *(self.camera, self.wire_map, segments, pairs, system, lists, hypotheses, window),
            k=least,
            distance=self.config.distance,
        )
        return (
            verdicts if not self.config.inside_window else inside(verdicts, viewed_disc(self.camera, window))
        )

    def _winner(
        self,
        errors: LineErrors,
        pairs: PairList,
        lists: tuple[Combinations, Combinations],
        hypotheses: HypothesisList,
        verdicts: Verdicts,
    ) -> Winner | None:
        """The best hypothesis with its pose; None where there is none."""
        if verdicts.best < 0:
            return None
        numbers = members(pairs, lists, hypotheses, verdicts.best)
        rows, lines, state = pairs.rows[numbers], pairs.lines[numbers], verdicts.cameras[verdicts.best]
        pose = robot_pose(self.camera, *state.tolist())
        covariance = pose_covariance(self.camera, self.wire_map, errors, rows, lines, state)
        return Winner(rows, lines, pose, covariance, float(verdicts.scores[verdicts.best]))

    def _reason(self, found: Interpretation) -> Reason:
        if found.lines < self.config.least:
            return Reason.TOO_FEW_SEGMENTS
        if len(found.selection.rows) < self.config.least:
            return Reason.NOTHING_VISIBLE
        return Reason.NO_HYPOTHESIS

    def _raw_pixels(self, predicted: Prediction) -> Array:
        normalised = predicted.ideal_px.reshape(-1, 2) / self.camera.focal_px
        return self.camera.distort(normalised).reshape(-1, 2, 2)


class _Clock:
    """Milliseconds from lap to lap."""

    def __init__(self) -> None:
        self.stage_ms: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.stage_ms[stage] = 1e3 * (now - self._since)
        self._since = now
