"""Pairing lines with predicted pieces: each line once, fragments together, neighbours apart."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import CAMERA, segments_at

from maps.poses import Array
from vision.association import Matches, associate
from vision.lines import ImageSegments
from vision.projection import Prediction, line_normals

Ends = tuple[float, float, float, float]


def pieces(*ends: Ends) -> Prediction:
    """Return pieces between ideal pixels (u0, v0, u1, v1), one metre ahead."""
    ideal = np.array(ends, float).reshape(-1, 2, 2)
    optical = np.concatenate([ideal / CAMERA.focal_px, np.ones((len(ideal), 2, 1))], axis=2)
    return Prediction(np.arange(len(ideal)), ideal, np.ones((len(ideal), 2)), line_normals(optical))


def lines(*ends: Ends) -> ImageSegments:
    return segments_at(np.array(ends, float).reshape(-1, 2, 2))


def paired(predicted: Prediction, found: ImageSegments, gate_px: float = 6.0) -> set[tuple[int, int]]:
    matches = associate(CAMERA, predicted, found, gate_px)
    assert len(matches) == len(matches.lines) == len(matches.spans_px) == len(matches.distances_px)
    return set(zip(matches.pieces.tolist(), matches.lines.tolist(), strict=True))


def test_a_line_goes_to_the_nearest_piece_alone() -> None:
    double = pieces((-100, 0, 100, 0), (-100, 4, 100, 4))
    assert paired(double, lines((-90, 1, 90, 1))) == {(0, 0)}
    assert paired(double, lines((-90, 3, 90, 3))) == {(1, 0)}


def test_of_two_lines_beside_each_other_the_nearer_is_claimed() -> None:
    edge = pieces((-100, 0, 100, 0))
    assert paired(edge, lines((-90, 3, 90, 3), (-90, -1, 90, -1))) == {(0, 1)}


def test_fragments_of_one_edge_are_claimed_together() -> None:
    edge = pieces((-100, 0, 100, 0))
    assert paired(edge, lines((-95, 1, -10, 1), (5, -0.5, 60, -0.5), (62, 0, 99, 0))) == {
        (0, 0),
        (0, 1),
        (0, 2),
    }


def test_direction_of_a_line_does_not_matter() -> None:
    assert paired(pieces((-100, 0, 100, 0)), lines((90, 1, -90, 1))) == {(0, 0)}


@pytest.mark.parametrize(
    "line",
    [
        pytest.param((-90, 7, 90, 7), id="too far"),
        pytest.param((-90, -8, 90, 8), id="too slanted"),
        pytest.param((0, -50, 0, 50), id="across"),
        pytest.param((150, 0, 250, 0), id="beyond its end"),
        pytest.param((70, 0, 170, 0), id="mostly beyond its end"),
    ],
)
def test_what_is_not_the_edge_is_not_claimed(line: Ends) -> None:
    assert paired(pieces((-100, 0, 100, 0)), lines(line)) == set()


def test_distances_and_spans_are_those_along_and_across_the_piece() -> None:
    matches = associate(CAMERA, pieces((-100, 0, 100, 0)), lines((-60, 1, 40, 3)), 6.0)
    np.testing.assert_allclose(np.abs(matches.distances_px), [[1.0, 3.0]], atol=1e-9)
    np.testing.assert_allclose(matches.spans_px, [[40.0, 140.0]], atol=1e-9)
    np.testing.assert_allclose(matches.rms_px, [np.sqrt(5.0)], atol=1e-9)


def test_best_matches_come_first_whatever_the_order() -> None:
    edges = pieces((-100, 0, 100, 0), (-100, 50, 100, 50), (-100, 90, 100, 90))
    found = [(-90.0, 2.0, 90.0, 2.0), (-90.0, 50.1, 90.0, 50.1), (-90.0, 91.0, 90.0, 91.0)]
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        matches = associate(CAMERA, edges, lines(*[found[row] for row in order]), 6.0)
        assert matches.pieces.tolist() == [1, 2, 0]


@pytest.mark.parametrize("count", [0, 3])
def test_nothing_to_pair_gives_no_matches(count: int) -> None:
    edges: list[Ends] = [(-100, 0, 100, 0)] * count
    for matches in (
        associate(CAMERA, pieces(), lines(*edges), 6.0),
        associate(CAMERA, pieces(*edges), lines(), 6.0),
    ):
        assert isinstance(matches, Matches)
        assert len(matches) == 0
        rms: Array = matches.rms_px
        assert rms.shape == (0,)
