"""The paper's matcher from segments to an outcome, on views of the toy building."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from drawing import BARREL, CAMERA, draw, exact_lines, poses_inside, segments_at, window_around
from toy_building import toy_building

from maps.outcomes import Fix, NoFix, Reason, SearchWindow
from maps.partition import PartitionConfig
from maps.poses import Pose2
from maps.regions import ViewRegions, build_regions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.lines import ImageSegments
from vision.paper.distance import SegmentDistance
from vision.paper.matcher import PaperConfig, PaperMatcher, ToleranceMethod
from vision.paper.selection import ViewedDisc
from vision.paper.tables import TableConfig
from vision.paper.verification import Verdicts, inside
from vision.paper.verticals import VerticalRule
from vision.projection import Projector

#: Few and long segments, as the paper's images have them, and a camera with its narrow view.
NARROW = replace(CAMERA, fx=1000.0, fy=1000.0, cx=320.0, cy=240.0)
QI1 = (0.30, math.radians(10.0))


@pytest.fixture(scope="module")
def regions(toy_map: WireMap) -> ViewRegions:
    return build_regions(toy_map, (1.2, 1.2), PartitionConfig(surplus=0.0))


def view(camera: Camera, wire_map: WireMap, pose: Pose2, most: int = 10) -> tuple[ImageSegments, list[int]]:
    """The longest exact lines of a view, one an edge, and the edges' rows."""
    seen = Projector(camera, wire_map).predict(pose, np.arange(len(wire_map)))
    order = np.argsort(-seen.lengths_px, kind="stable")
    _, first = np.unique(seen.rows[order], return_index=True)
    chosen = order[np.sort(first)][:most]
    return exact_lines(camera, seen)[chosen], seen.rows[chosen].tolist()


def cases(wire_map: WireMap, count: int, seed: int) -> Iterator[tuple[Pose2, SearchWindow]]:
    rng = np.random.default_rng(seed)
    for pose in poses_inside(wire_map, rng, 200):
        if len(view(NARROW, wire_map, pose)[0]) >= 6:
            yield pose, window_around(pose, rng, *QI1)
            count -= 1
        if not count:
            return


CONFIGS = {
    "default": PaperConfig(),
    "monte carlo": PaperConfig(tolerances=ToleranceMethod.MONTE_CARLO, table=TableConfig(samples=60)),
    "sector, inside": PaperConfig(vertical_sector=True, inside_window=True),
    "slopes, printed": PaperConfig(vertical_rule=VerticalRule.SLOPE, distance=SegmentDistance.PRINTED),
    "share": PaperConfig(least_share=0.5),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_exact_lines_give_the_pose(
    toy_map: WireMap,
    regions: ViewRegions,
    name: str,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    matcher = PaperMatcher(NARROW, toy_map, regions, CONFIGS[name])
    right = 0
    for pose, window in cases(toy_map, 5, 80):
        segments, rows = view(NARROW, toy_map, pose, 8)
        outcome = matcher.match_segments(segments, 7, window)
        if isinstance(outcome, Fix):
            away = outcome.belief.pose.minus(pose)
            right += bool(np.hypot(away[0], away[1]) < 0.02 and abs(away[2]) < 0.005)
            assert outcome.belief.stamp_ns == 7
            assert len(outcome.look.matched_map) == len(outcome.look.matched_image) >= 4
            assert len(outcome.look.residuals_px) == len(outcome.look.matched_map)
            assert outcome.look.selected >= len(rows)
            assert outcome.look.hypotheses > 0
    assert right >= 4


def test_the_true_pairs_pass_every_stage(toy_map: WireMap, regions: ViewRegions) -> None:
    matcher = PaperMatcher(NARROW, toy_map, regions)
    for pose, window in cases(toy_map, 10, 81):
        segments, rows = view(NARROW, toy_map, pose, 8)
        found = matcher.interpret(segments, window)
        vertical = set(found.selection.vertical.tolist())
        unary = set(zip(found.unary.rows.tolist(), found.unary.lines.tolist(), strict=True))
        upright = list(zip(found.verticals.rows.tolist(), found.verticals.lines.tolist(), strict=True))
        true = list(zip(rows, range(len(rows)), strict=True))
        assert {pair for pair in true if pair[0] not in vertical} <= unary
        places = [upright.index(pair) for pair in true if pair[0] in vertical]
        agrees = found.verticals.agrees[np.ix_(places, places)] + np.eye(len(places))
        assert (agrees > 0).all()
        listed = [
            {upright[pair] for pair in pairs[:size]}
            for pairs, size in zip(found.vertical_list.pairs, found.vertical_list.sizes, strict=True)
        ]
        if len(places) >= 2:
            assert {upright[place] for place in places} in listed


def test_what_is_counted_adds_up(toy_map: WireMap, regions: ViewRegions) -> None:
    pose, window = next(cases(toy_map, 1, 82))
    segments, _ = view(NARROW, toy_map, pose)
    found = PaperMatcher(NARROW, toy_map, regions).interpret(segments, window)
    counts = found.counts()
    assert counts["mv"] + counts["mh"] == counts["selected"]
    assert counts["nv"] + counts["nh"] == counts["n"] == len(segments)
    assert counts["most_hypotheses"] == (counts["n"] + 1) ** counts["mh"] * (counts["nv"] + 1) ** counts["mv"]
    assert counts["unary_tested"] == counts["mh"] * counts["n"]
    assert counts["products"] == counts["horizontal_list"] * counts["vertical_list"]
    assert counts["hypotheses"] == counts["hypotheses_counted"] == len(found.verdicts.scores)
    assert not counts["exhausted"]
    assert found.winner is not None
    assert found.winner.score_px == found.verdicts.scores.min()
    stages = ["selection", "division", "unary", "binary", "order", "trees", "product", "verification"]
    assert list(found.stage_ms) == stages
    assert counts["total_ms"] == sum(found.stage_ms.values()) > 0.0
    lines = found.winner.lines
    assert len(np.unique(lines)) == len(lines)
    assert len(np.unique(found.winner.rows)) == len(found.winner.rows)


@pytest.mark.parametrize(
    "limits",
    [{"budget": 20}, {"max_combinations": 3}, {"max_vertical_pairs": 2}],
    ids=["budget", "combinations", "vertical pairs"],
)
def test_every_limit_that_is_reached_is_told(
    toy_map: WireMap, regions: ViewRegions, limits: dict[str, int]
) -> None:
    pose, window = next(cases(toy_map, 1, 83))
    segments, _ = view(NARROW, toy_map, pose)
    assert not PaperMatcher(NARROW, toy_map, regions).interpret(segments, window).exhausted
    found = PaperMatcher(NARROW, toy_map, regions, PaperConfig(**limits)).interpret(segments, window)
    assert found.exhausted
    assert found.counts()["exhausted"]
    assert len(found.hypotheses) <= limits.get("budget", 10**9)


def test_without_an_estimate_the_process_is_the_same(toy_map: WireMap, regions: ViewRegions) -> None:
    pose, _ = next(cases(toy_map, 1, 84))
    segments, _ = view(NARROW, toy_map, pose, 5)
    config = PaperConfig(budget=2_000, max_combinations=2_000)
    found = PaperMatcher(NARROW, toy_map, regions, config).interpret(
        segments, SearchWindow(Pose2(6.0, 3.0, 0.0), 20.0, math.pi)
    )
    assert len(found.selection.regions) == len(regions)
    assert found.exhausted
    assert 500 < len(found.hypotheses) <= 2_000


def test_hypotheses_inside_the_window_alone() -> None:
    disc = ViewedDisc(np.array([1.0, 2.0]), 0.5, 3.0, 0.2)
    cameras = np.array([[3.0, 1.6, 2.0], [2.7, 1.0, 2.0], [3.1 - 2.0 * math.pi, 1.0, 2.4], [3.0, 1.0, 2.0]])
    found = inside(Verdicts(cameras, np.array([1.0, 2.0, 3.0, 4.0]), 0), disc)
    assert found.scores.tolist() == [math.inf, math.inf, 3.0, 4.0]
    assert found.best == 2
    assert inside(Verdicts(cameras[:2], np.array([1.0, 2.0]), 0), disc).best == -1


def test_reasons(toy_map: WireMap, regions: ViewRegions) -> None:
    pose, window = next(cases(toy_map, 1, 86))
    segments, _ = view(NARROW, toy_map, pose)
    matcher = PaperMatcher(NARROW, toy_map, regions)
    few = matcher.match_segments(segments[:3], 0, window)
    none = matcher.match_segments(segments[:0], 0, window)
    for outcome in (few, none):
        assert isinstance(outcome, NoFix)
        assert outcome.reason is Reason.TOO_FEW_SEGMENTS
    corner = np.array([[[-300.0, -220.0], [-240.0, -215.0]]]) + np.arange(8)[:, None, None] * [1.0, 2.5]
    lost = matcher.match_segments(segments_at(corner), 0, SearchWindow(Pose2(7.2, 3.2, 0.0), 0.01, 0.01))
    assert isinstance(lost, NoFix)
    assert lost.reason in {Reason.NO_HYPOTHESIS, Reason.NOTHING_VISIBLE, Reason.WEAK_GEOMETRY}


def test_the_same_question_has_the_same_answer(toy_map: WireMap, regions: ViewRegions) -> None:
    pose, window = next(cases(toy_map, 1, 87))
    segments, _ = view(NARROW, toy_map, pose)
    first, second = (
        PaperMatcher(NARROW, toy_map, regions).match_segments(segments, 0, window) for _ in range(2)
    )
    assert isinstance(first, Fix)
    assert isinstance(second, Fix)
    assert first.belief.pose == second.belief.pose
    np.testing.assert_array_equal(first.belief.covariance, second.belief.covariance)


def test_a_picture_goes_through(toy_map: WireMap, regions: ViewRegions) -> None:
    pose = Pose2(1.0, 1.0, 0.6)
    image = draw(toy_building().faces, BARREL, pose, np.random.default_rng(88))
    config = PaperConfig(budget=3_000, max_combinations=3_000)
    matcher = PaperMatcher(BARREL, toy_map, regions, config)
    outcome = matcher.match(image, 5, SearchWindow(pose, 0.1, 0.05))
    assert len(outcome.look.lines_px) > 10
    assert matcher.timing_ms["extract"] > 0.0
    assert matcher.timing_ms["match"] > 0.0
