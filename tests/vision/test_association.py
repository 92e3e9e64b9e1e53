"""Pairing lines with predicted pieces: each line once, fragments together, neighbours apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, segments_at

from maps.poses import Array
from vision.association import GATE_SIGMAS, Matches, associate
from vision.measurements import LineMeasurements, measured_lines
from vision.projection import Prediction, line_normals

Ends = tuple[float, float, float, float]
#: A gate of 6 px, for lines half a pixel off.
POSE_PX = 2.0


def pieces(*ends: Ends) -> Prediction:
    """Return pieces between ideal pixels (u0, v0, u1, v1), one metre ahead."""
    ideal = np.array(ends, float).reshape(-1, 2, 2)
    optical = np.concatenate([ideal / CAMERA.focal_px, np.ones((len(ideal), 2, 1))], axis=2)
    ones = np.ones((len(ideal), 2))
    return Prediction(np.arange(len(ideal)), ideal, ones, line_normals(optical), ones * [0.0, 1.0])


def lines(*ends: Ends) -> LineMeasurements:
    return measured_lines(segments_at(np.array(ends, float).reshape(-1, 2, 2)), CAMERA.focal_px, 0.0)


def matched(
    predicted: Prediction, found: LineMeasurements, map_px: float = 0.0, polarity: float = 0.0
) -> Matches:
    ones = np.ones(len(predicted))
    return associate(predicted, found, POSE_PX, map_px * ones, polarity * ones)


def paired(
    predicted: Prediction, found: LineMeasurements, map_px: float = 0.0, polarity: float = 0.0
) -> set[tuple[int, int]]:
    matches = matched(predicted, found, map_px, polarity)
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


def test_the_gate_is_three_standard_deviations_of_all_that_is_uncertain() -> None:
    edge, sigma_px = pieces((-100, 0, 100, 0)), float(lines((-90, 0, 90, 0)).sigma_middle_px[0])
    for map_px in (0.0, 1.0, 5.0):
        gate = GATE_SIGMAS * float(np.sqrt(POSE_PX**2 + map_px**2 + sigma_px**2))
        assert paired(edge, lines((-90, gate - 0.01, 90, gate - 0.01)), map_px) == {(0, 0)}
        assert paired(edge, lines((-90, gate + 0.01, 90, gate + 0.01)), map_px) == set()
        # Half by place and half by slant: the two errors count together.
        slanted = float(np.sqrt(2.0)) * gate
        assert paired(edge, lines((-90, slanted - 0.1, 90, 0)), map_px) == {(0, 0)}
        assert paired(edge, lines((-90, slanted + 0.1, 90, 0)), map_px) == set()


def test_a_doubtful_edge_reaches_farther_and_its_neighbour_does_not() -> None:
    both = pieces((-100, 0, 100, 0), (-100, 60, 100, 60))
    found, map_px = lines((-90, 10, 90, 10), (-90, 70, 90, 70)), np.array([5.0, 0.1])
    matches = associate(both, found, POSE_PX, map_px, np.zeros(2))
    assert matches.pieces.tolist() == [0]
    assert matches.lines.tolist() == [0]


def test_a_line_measured_well_at_its_pivot_is_judged_there() -> None:
    """The two points lie about the pivot, and the distances are those of the points."""
    found = segments_at(np.array([[[-60.0, 0.0], [40.0, 2.0]]]))
    pivot = np.array([30.0])
    matches = matched(
        pieces((-100, 0, 100, 0)), measured_lines(replace(found, pivot_px=pivot), CAMERA.focal_px, 0)
    )
    slope, length = 2.0 / 100.0, float(found.lengths_px[0])
    expected = 1.0 + (30.0 + 0.5 * length * np.array([-1.0, 1.0])) * slope / np.hypot(1.0, slope)
    np.testing.assert_allclose(matches.distances_px, [expected], atol=1e-9)
    np.testing.assert_allclose(matches.spans_px, [[40.0, 140.0]], atol=1e-9)


@pytest.mark.parametrize("turned", [False, True])
def test_a_line_bright_on_the_wrong_side_is_not_claimed(turned: bool) -> None:
    edge = pieces((100, 0, -100, 0) if turned else (-100, 0, 100, 0))
    right = -1.0 if turned else 1.0  # lines are brighter on the right looking along them
    for line, sign in (((-90.0, 1.0, 90.0, 1.0), 1.0), ((90.0, 1.0, -90.0, 1.0), -1.0)):
        assert paired(edge, lines(line), polarity=0.0) == {(0, 0)}
        assert paired(edge, lines(line), polarity=sign * right) == {(0, 0)}
        assert paired(edge, lines(line), polarity=-sign * right) == set()


def test_a_line_bright_on_the_wrong_side_goes_to_a_neighbour_that_fits() -> None:
    double = pieces((-100, 0, 100, 0), (-100, 4, 100, 4))
    matches = associate(
        double, lines((-90, 0.5, 90, 0.5)), POSE_PX, np.zeros(2), polarity=np.array([-1.0, 1.0])
    )
    assert matches.pieces.tolist() == [1]


def test_distances_and_spans_are_those_along_and_across_the_piece() -> None:
    matches = matched(pieces((-100, 0, 100, 0)), lines((-60, 1, 40, 3)))
    np.testing.assert_allclose(np.abs(matches.distances_px), [[1.0, 3.0]], atol=1e-9)
    np.testing.assert_allclose(matches.spans_px, [[40.0, 140.0]], atol=1e-9)
    np.testing.assert_allclose(matches.rms_px, [np.sqrt(5.0)], atol=1e-9)


def test_best_matches_come_first_whatever_the_order() -> None:
    edges = pieces((-100, 0, 100, 0), (-100, 50, 100, 50), (-100, 90, 100, 90))
    found = [(-90.0, 2.0, 90.0, 2.0), (-90.0, 50.1, 90.0, 50.1), (-90.0, 91.0, 90.0, 91.0)]
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        matches = matched(edges, lines(*[found[row] for row in order]))
        assert matches.pieces.tolist() == [1, 2, 0]


@pytest.mark.parametrize("count", [0, 3])
def test_nothing_to_pair_gives_no_matches(count: int) -> None:
    edges: list[Ends] = [(-100, 0, 100, 0)] * count
    for matches in (matched(pieces(), lines(*edges)), matched(pieces(*edges), lines())):
        assert isinstance(matches, Matches)
        assert len(matches) == 0
        rms: Array = matches.rms_px
        assert rms.shape == (0,)
