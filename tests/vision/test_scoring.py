"""Scores: the true pose above its neighbours, and edges that are missing count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, exact_lines, poses_inside, segments_at
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.association import associate
from vision.constraints import unary_correspondences
from vision.lines import ImageSegments
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig, log_likelihood_ratio, quick_scores

GATE_PX = 4.0
SHIFTS = [(0.1, 0, 0), (-0.1, 0, 0), (0, 0.1, 0), (0, -0.1, 0), (0, 0, 0.03), (0, 0, -0.03), (0.2, 0.2, 0.1)]


def views(wire_map: WireMap, count: int) -> list[tuple[Pose2, Prediction]]:
    projector, rows = Projector(CAMERA, wire_map), np.arange(len(wire_map))
    poses = poses_inside(wire_map, np.random.default_rng(23), 4 * count)
    seen = [(pose, projector.predict(pose, rows)) for pose in poses]
    return [(pose, view) for pose, view in seen if len(view) >= 12][:count]


def evidence(wire_map: WireMap, predicted: Prediction, lines: ImageSegments) -> float:
    matches = associate(CAMERA, predicted, lines, GATE_PX)
    sigma = np.full(len(matches), 0.5)
    return log_likelihood_ratio(wire_map, predicted, matches, lines, CAMERA, GATE_PX, sigma, EvidenceConfig())


def taken(view: Prediction, rows: NDArray[np.int64]) -> Prediction:
    return Prediction(view.rows[rows], view.ideal_px[rows], view.depths_m[rows], view.normals[rows])


def some_lines(lines: ImageSegments, keep: Array) -> ImageSegments:
    return lines[keep]


def test_the_true_pose_has_more_evidence_than_shifted_ones(toy_map: WireMap) -> None:
    projector, rows = Projector(CAMERA, toy_map), np.arange(len(toy_map))
    for pose, view in views(toy_map, 15):
        lines = exact_lines(CAMERA, view)
        true = evidence(toy_map, view, lines)
        assert true > 30.0
        for shift in SHIFTS:
            moved = projector.predict(Pose2.from_array(pose.as_array() + shift), rows)
            assert evidence(toy_map, moved, lines) < true


def test_edges_that_should_be_seen_and_are_not_count_against_the_pose(toy_map: WireMap) -> None:
    for _, view in views(toy_map, 10):
        lines = exact_lines(CAMERA, view)
        for missing in range(len(view)):
            keep = np.arange(len(view)) != missing
            only = some_lines(lines, keep)
            assert evidence(toy_map, view, only) < evidence(toy_map, taken(view, np.flatnonzero(keep)), only)


def test_a_missing_edge_costs_more_where_the_map_has_learnt_that_it_shows(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    lines = some_lines(exact_lines(CAMERA, view), np.arange(len(view)) != 0)
    rates = [replace(toy_map, detection_rate=np.full(len(toy_map), rate)) for rate in (0.1, 0.9)]
    lost = [
        evidence(learnt, taken(view, np.arange(1, len(view))), lines) - evidence(learnt, view, lines)
        for learnt in rates
    ]
    assert 0.0 < lost[0] < lost[1]


def test_no_lines_is_evidence_against_and_no_prediction_is_none(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    nothing = some_lines(exact_lines(CAMERA, view), np.zeros(0, np.int64))
    assert evidence(toy_map, view, nothing) < 0.0
    assert evidence(toy_map, taken(view, np.zeros(0, np.int64)), exact_lines(CAMERA, view)) == 0.0


def test_a_picture_full_of_strokes_proves_less(toy_map: WireMap) -> None:
    rng = np.random.default_rng(24)
    _, view = views(toy_map, 1)[0]
    lines = exact_lines(CAMERA, view)
    starts = rng.uniform([-300, -220], [300, 220], (800, 2))
    stray = np.stack([starts, starts + rng.normal(0.0, 60.0, starts.shape)], axis=1)
    ideal = np.concatenate([lines.ideal_px, stray])
    busy = segments_at(ideal)
    matches, sigma = associate(CAMERA, view, lines, GATE_PX), np.full(len(view), 0.5)
    scores = [
        log_likelihood_ratio(
            toy_map, view, matches, found, CAMERA, GATE_PX, sigma[: len(matches)], EvidenceConfig()
        )
        for found in (lines, busy)
    ]
    assert scores[1] < scores[0]


def test_quick_scores_peak_at_the_true_pose_and_there_cover_all_that_is_predicted(toy_map: WireMap) -> None:
    for pose, view in views(toy_map, 10):
        lines = exact_lines(CAMERA, view)
        window = SearchWindow(pose, 0.3, 0.17)
        pairs = unary_correspondences(CAMERA, toy_map, lines, view, window)
        poses = pose.as_array() + np.array([(0.0, 0.0, 0.0), *SHIFTS])
        scores = quick_scores(CAMERA, toy_map, lines, pairs, view, poses, 4.0)
        assert scores.shape == (len(poses),)
        assert scores.argmax() == 0
        assert scores[0] == pytest.approx(view.lengths_px.sum(), rel=0.02)


def test_quick_scores_do_not_depend_on_the_company(toy_map: WireMap) -> None:
    pose, view = views(toy_map, 1)[0]
    lines = exact_lines(CAMERA, view)
    pairs = unary_correspondences(CAMERA, toy_map, lines, view, SearchWindow(pose, 0.3, 0.17))
    poses = pose.as_array() + np.random.default_rng(25).normal(0.0, 0.1, (300, 3))
    together = quick_scores(CAMERA, toy_map, lines, pairs, view, poses, 4.0)
    alone = [quick_scores(CAMERA, toy_map, lines, pairs, view, row[None], 4.0)[0] for row in poses[::40]]
    np.testing.assert_allclose(together[::40], alone, rtol=1e-9)
    assert quick_scores(CAMERA, toy_map, lines, pairs, view, poses[:0], 4.0).shape == (0,)
