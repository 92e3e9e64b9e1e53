"""The stages of the paper's line extractor, one by one, and what they make of drawn edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE

from maps.poses import Array
from tests.drawnedges import draw_edge, miss_of
from vision.camera import Camera
from vision.edgelines import EdgeConfig
from vision.gradient import Gradient
from vision.houghlines import (
    END_SIGMA_PX,
    HoughConfig,
    back_votes,
    cast_votes,
    find_hough,
    find_runs,
    oriented,
)

CONFIG = HoughConfig()
PLAIN = replace(CAMERA, cx=0.0, cy=0.0)


def along(angle: float, distance: float, places: Array) -> Array:
    """Points at `places` along the line cos(a) u + sin(a) v = d."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    return distance * normal + places[:, None] * np.array([-normal[1], normal[0]])


def test_a_pixel_votes_once_per_orientation_near_its_gradient() -> None:
    angle, point = 0.7, along(0.7, 30.0, np.array([12.0]))
    votes = cast_votes(point, np.array([angle]), CONFIG, 1000.0)
    rows, columns = np.nonzero(votes)
    assert votes.max() == 1
    assert len(rows) == len(set(rows)) == 11, "ten degrees to either side, in cells of two"
    angles = rows * np.radians(2.0)
    assert np.abs(angles - angle).max() <= CONFIG.range_rad + 0.5 * CONFIG.cell_rad
    distances = np.cos(angles) * point[0, 0] + np.sin(angles) * point[0, 1]
    np.testing.assert_allclose(columns - votes.shape[1] // 2, distances / CONFIG.cell_px, atol=0.5)


@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi / 2, np.pi, -np.pi, -0.001, -2.0])
def test_a_lines_votes_meet_in_its_cell(angle: float) -> None:
    points = along(angle, 20.0, np.arange(-40.0, 41.0))
    votes = cast_votes(points, np.full(81, angle), CONFIG, 1000.0)
    row, column = np.unravel_index(votes.argmax(), votes.shape)
    assert votes.max() > 50
    assert abs(np.angle(np.exp(1j * (row * np.radians(2.0) - angle)))) <= np.radians(2.0)
    assert abs(column - votes.shape[1] // 2 - 20.0) <= 1.0


def test_pixels_beyond_reach_or_nowhere_have_no_vote_and_back_nothing() -> None:
    points = np.array([[5.0, 5.0], [900.0, 0.0], [np.nan, 1.0], [np.inf, 0.0], [4.0, 4.0]])
    normal = np.array([0.0, 0.0, 0.0, 0.0, np.nan])
    votes = cast_votes(points, normal, CONFIG, 100.0)
    assert votes.sum() == 11
    assert votes.shape[1] < 20
    backed = back_votes(points, normal, replace(CONFIG, chain_px=2.0), np.maximum(votes, 2 * votes))
    assert (backed >= 0).tolist() == [True, False, False, False, False]


def test_each_pixel_of_two_crossing_lines_backs_its_own() -> None:
    angles = np.radians([10.0, 50.0])
    points = np.concatenate([along(angle, 15.0, np.arange(-30.0, 31.0)) for angle in angles])
    normal = np.repeat(angles, 61) + np.random.default_rng(0).uniform(-0.1, 0.1, 122)
    votes = cast_votes(points, normal, CONFIG, 1000.0)
    backed = back_votes(points, normal, CONFIG, votes)
    np.testing.assert_array_equal(backed, np.repeat([5, 25], 61))
    few = back_votes(points, normal, replace(CONFIG, chain_px=200.0), votes)
    assert (few == -1).all(), "lines of too few votes are none"


@pytest.mark.parametrize(
    ("backed", "runs"),
    [
        ([4, 4, 5, 5, 4], [(0, 4)]),
        ([4, 4, 4, 9, 9, 9, 4, 4], [(0, 7)]),
        ([4, 4, 4, -1, 9, -1, 9, 4, 4], [(0, 2), (4, 6), (7, 8)]),
        ([0, 179, 0, 1], [(0, 3)]),
        ([-1, -1, 7, 7], [(2, 3)]),
        ([-1, -1], []),
    ],
    ids=["neighbours", "astray", "too long astray", "full turn", "late", "nothing"],
)
def test_runs_of_one_line(backed: list[int], runs: list[tuple[int, int]]) -> None:
    starts = np.array([0, len(backed)], np.int32)
    found = find_runs(np.array(backed, np.int32), starts, 180, 3)
    assert [run for run in map(tuple, found.tolist()) if run[0] != run[1]] == runs


def test_runs_end_with_their_chain() -> None:
    found = find_runs(np.full(10, 3, np.int32), np.array([0, 4, 10], np.int32), 180, 3)
    assert found.tolist() == [[0, 3], [4, 9]]


@pytest.mark.parametrize("camera", [PLAIN, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
def test_gradients_are_turned_as_the_lens_turns_the_edge(camera: Camera) -> None:
    angle = 0.6
    ideal = along(angle, 120.0, np.linspace(20.0, 160.0, 30))
    ahead = along(angle, 120.0, np.linspace(20.0, 160.0, 30) + 0.01)
    raw, way = camera.distort(ideal / camera.focal_px), camera.distort(ahead / camera.focal_px)
    way = (way - raw) / np.linalg.norm(way - raw, axis=1, keepdims=True)
    slopes = np.rint(4000.0 * way[:, ::-1] * [1.0, -1.0]).astype(np.int16)
    cells = np.arange(30, dtype=np.int32)
    gradient = Gradient(slopes[:, :1], slopes[:, 1:], 0.0)
    straight, normal = oriented(raw, cells, gradient, camera)
    np.testing.assert_allclose(straight, ideal, atol=0.02)
    np.testing.assert_allclose(normal, angle, atol=np.radians(0.5))


def test_drawn_edges_are_found_as_well_as_pixels_tell_and_the_deviation_is_honest() -> None:
    rng, rows = np.random.default_rng(4), []
    for _ in range(60):
        edge = draw_edge(rng)
        lines = find_hough(edge.image, PLAIN, CONFIG, EdgeConfig())
        np.testing.assert_allclose(lines.raw_px, lines.ideal_px)
        miss = miss_of(edge, lines.raw_px)
        if miss is None:
            continue
        assert miss.sense == 1.0, "the brighter side is on the right"
        length = np.linalg.norm(lines.raw_px[miss.row, 1] - lines.raw_px[miss.row, 0])
        rows.append([miss.offset_px * np.sqrt(2.0), miss.angle_rad * length / np.sqrt(2.0)])
    assert len(rows) >= 58
    scaled = np.mean(np.square(rows), axis=0) / END_SIGMA_PX**2
    # Sixty squares of a standard normal average to 1 with a deviation of 0.18.
    assert ((scaled > 0.5) & (scaled < 1.6)).all()


def test_the_two_edges_of_a_thin_bar_are_two_lines() -> None:
    image = np.full((120, 160), 60, np.uint8)
    image[20:100, 80:84] = 200
    lines = find_hough(image, PLAIN, CONFIG, EdgeConfig())
    upright = np.sort(lines.raw_px[:, :, 0].mean(axis=1))
    np.testing.assert_allclose(upright, [79.5, 83.5], atol=0.75)
    down = lines.raw_px[:, 1, 1] > lines.raw_px[:, 0, 1]
    assert down.tolist().count(True) == 1


def test_bends_are_cut_where_the_polygon_says() -> None:
    y, x = np.indices((400, 400))
    disc = np.where(np.hypot(x - 200.0, y - 200.0) < 150.0, 200, 60).astype(np.uint8)
    lines = find_hough(disc, PLAIN, CONFIG, EdgeConfig())
    middles = lines.raw_px.mean(axis=1) - 200.0
    assert len(lines.raw_px) > 5
    # A chord's middle lies inside by its sagitta, within the tolerance and half a pixel.
    assert np.abs(np.linalg.norm(middles, axis=1) - 149.0).max() < CONFIG.straight_px + 1.0


@pytest.mark.parametrize("name", ["cell_px", "cell_rad", "range_rad", "chain_px", "straight_px"])
def test_sizes_must_be_positive(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        HoughConfig(**{name: 0.0})
