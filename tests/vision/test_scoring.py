"""Scores: the true pose above its neighbours, and edges that are missing count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, exact_lines, poses_inside, segments_at, some_pieces
from numpy.typing import NDArray
from scipy import stats

from maps.poses import Pose2
from maps.wiremap import WireMap
from vision.association import GATE_SIGMAS, Matches, associate
from vision.lines import ImageSegments
from vision.measurements import LineMeasurements, measured_lines
from vision.projection import Prediction, Projector
from vision.scoring import EvidenceConfig, log_likelihood_ratio

POSE_PX = 1.3
GATE_PX = GATE_SIGMAS * POSE_PX
SHIFTS = [(0.1, 0, 0), (-0.1, 0, 0), (0, 0.1, 0), (0, -0.1, 0), (0, 0, 0.03), (0, 0, -0.03), (0.2, 0.2, 0.1)]


def views(wire_map: WireMap, count: int) -> list[tuple[Pose2, Prediction]]:
    projector, rows = Projector(CAMERA, wire_map), np.arange(len(wire_map))
    poses = poses_inside(wire_map, np.random.default_rng(23), 4 * count)
    seen = [(pose, projector.predict(pose, rows)) for pose in poses]
    return [(pose, view) for pose, view in seen if len(view) >= 12][:count]


def measured(segments: ImageSegments) -> LineMeasurements:
    return measured_lines(segments, CAMERA.focal_px, 0.5)


def matched(wire_map: WireMap, predicted: Prediction, lines: ImageSegments) -> Matches:
    polarity = wire_map.polarity[predicted.rows]
    return associate(predicted, measured(lines), POSE_PX, np.zeros(len(predicted)), polarity)


def weighed(
    wire_map: WireMap,
    predicted: Prediction,
    matches: Matches,
    lines: ImageSegments,
    gate_px: float = GATE_PX,
    student: float = 3.0,
) -> float:
    return log_likelihood_ratio(
        predicted,
        matches,
        measured(lines),
        EvidenceConfig().rates(wire_map.detection_rate[predicted.rows]),
        np.full(len(predicted), gate_px),
        np.full(len(matches), 0.5),
        float(CAMERA.width * CAMERA.height),
        student,
        EvidenceConfig(),
    )


def evidence(wire_map: WireMap, predicted: Prediction, lines: ImageSegments) -> float:
    return weighed(wire_map, predicted, matched(wire_map, predicted, lines), lines)


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
            only = lines[keep]
            assert evidence(toy_map, view, only) < evidence(toy_map, some_pieces(view, keep), only)


def test_a_missing_edge_costs_more_where_the_map_has_learnt_that_it_shows(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    keep = np.arange(len(view)) != 0
    lines = exact_lines(CAMERA, view)[keep]
    rates = [replace(toy_map, detection_rate=np.full(len(toy_map), rate)) for rate in (0.1, 0.9)]
    lost = [
        evidence(learnt, some_pieces(view, keep), lines) - evidence(learnt, view, lines) for learnt in rates
    ]
    assert 0.0 < lost[0] < lost[1]


def test_edges_bright_on_the_wrong_side_are_edges_not_seen(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    lines = exact_lines(CAMERA, view)
    known, against = (replace(toy_map, polarity=np.full(len(toy_map), side)) for side in (1.0, -1.0))
    nothing = lines[np.zeros(0, np.int64)]
    assert evidence(known, view, lines) == evidence(toy_map, view, lines)
    # All that the lines of a picture with other sides do is to make accidents likelier.
    assert evidence(against, view, lines) < 0.0
    assert evidence(against, view, lines) == pytest.approx(evidence(toy_map, view, nothing), rel=0.3)


def test_no_lines_is_evidence_against_and_no_prediction_is_none(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    none: NDArray[np.int64] = np.zeros(0, np.int64)
    lines = exact_lines(CAMERA, view)
    assert evidence(toy_map, view, lines[none]) < 0.0
    assert evidence(toy_map, some_pieces(view, none), lines) == 0.0


def test_a_picture_full_of_strokes_proves_less(toy_map: WireMap) -> None:
    rng = np.random.default_rng(24)
    _, view = views(toy_map, 1)[0]
    lines = exact_lines(CAMERA, view)
    starts = rng.uniform([-300, -220], [300, 220], (800, 2))
    stray = np.stack([starts, starts + rng.normal(0.0, 60.0, starts.shape)], axis=1)
    busy = segments_at(np.concatenate([lines.ideal_px, stray]))
    matches = matched(toy_map, view, lines)
    assert weighed(toy_map, view, matches, busy) < weighed(toy_map, view, matches, lines)


def test_one_edge_is_worth_what_the_formula_says(toy_map: WireMap) -> None:
    """A piece of 120 px is four looks; half of it is covered, 0.7 px off, in an image with little else."""
    ideal = np.array([[[-60.0, 10.0], [60.0, 10.0]]])
    normals = np.array([[0.0, 1.0, -10.0 / CAMERA.focal_px]])
    edge = Prediction(np.zeros(1, np.int64), ideal, np.ones((1, 2)), normals, np.array([[0.0, 1.0]]))
    lines = segments_at(np.array([[[-60.0, 10.7], [0.0, 10.7]]]))
    config = EvidenceConfig()
    rate, chance = config.detection_rate, config.min_chance
    looks = 2.0 * np.log((rate + (1.0 - rate) * chance) / chance) + 2.0 * np.log(1.0 - rate)
    closeness = np.log(2.0 * GATE_PX) + stats.t(3, scale=0.5).logpdf(0.7)
    assert evidence(toy_map, edge, lines) == pytest.approx(looks + closeness)


def test_a_match_at_some_distance_is_worth_less_and_least_under_gaussian_noise(toy_map: WireMap) -> None:
    _, view = views(toy_map, 1)[0]
    lines = exact_lines(CAMERA, view)
    matches = matched(toy_map, view, lines)
    apart = replace(matches, distances_px=matches.distances_px + 2.0)
    lost = [
        weighed(toy_map, view, matches, lines, student=student)
        - weighed(toy_map, view, apart, lines, student=student)
        for student in (3.0, 1000.0)
    ]
    assert 0.0 < lost[0] < lost[1]
