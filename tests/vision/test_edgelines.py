"""The stages of line extraction, one by one, and what they make of drawn edges."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import BARREL, FISHEYE
from scipy.special import ndtr

from maps.poses import Array
from tests.drawnedges import draw_edge, miss_of
from vision.camera import Camera, CameraModel, CameraMount
from vision.edgelines import EdgeConfig, find_edges
from vision.edgepoints import NX, NY, X, Y, link_edges, mark_edges, measure_points
from vision.gradient import GAIN, gradient_of, pixel_noise
from vision.images import GreyImage
from vision.pieces import split_chains
from vision.straightening import straighten

PLAIN = Camera(
    CameraModel.PINHOLE_RADTAN, 640, 480, 640.0, 640.0, 0.0, 0.0, np.zeros(5), CameraMount()
)  # fmt: skip


def grey(levels: Array, rng: np.random.Generator, noise: float = 1.0) -> GreyImage:
    image: GreyImage = np.clip(np.rint(levels + rng.normal(0.0, noise, levels.shape)), 0, 255).astype(
        np.uint8
    )
    return image


def halves(bright: float = 180.0, dark: float = 60.0, at: float = 50.0, blur: float = 0.7) -> Array:
    """A picture (80, 100), dark left of the column `at`, as a lens blurs it."""
    return np.tile(dark + (bright - dark) * ndtr((np.arange(100) - at) / blur), (80, 1))


def test_a_ramp_has_the_slope_it_was_made_with() -> None:
    ramp = np.tile(2.0 * np.arange(100), (50, 1)).astype(np.uint8)
    gradient = gradient_of(ramp, 1.0)
    np.testing.assert_allclose(gradient.dx[10:-10, 10:-10], 2.0 * GAIN, atol=1)
    assert not gradient.dy[10:-10, 10:-10].any()


@pytest.mark.parametrize("sigma", [1.0, 3.0, 8.0])
def test_noise_is_told_from_edges_and_clipped_parts(sigma: float) -> None:
    rng = np.random.default_rng(0)
    image = grey(np.tile(np.where(np.arange(640) // 40 % 2, 100.0, 160.0), (480, 1)), rng, sigma)
    image[:, 400:] = 255
    assert pixel_noise(image) == pytest.approx(sigma, rel=0.15)
    assert gradient_of(image, 1.0).noise == pytest.approx(sigma / np.sqrt(8.0 * np.pi), rel=0.25)


@pytest.mark.parametrize("at", [50.0, 50.2, 50.4, 50.5, 50.7])
def test_edge_points_are_measured_between_pixels(at: float) -> None:
    gradient = gradient_of(grey(halves(at=at), np.random.default_rng(1), 0.3), 1.0)
    marks, seeds = mark_edges(gradient.dx, gradient.dy, 5.0, 10.0)
    cells, starts = link_edges(gradient.dx, gradient.dy, marks, seeds, 20)
    assert starts.tolist() == [0, 76], "one chain, but for the border"
    points = measure_points(gradient.dx, gradient.dy, cells)
    assert abs(points[:, X].mean() - at) < 0.01
    assert points[:, X].std() < 0.02
    np.testing.assert_allclose(points[:, [NX, NY]], np.tile([1.0, 0.0], (76, 1)), atol=0.05)
    assert np.all(np.diff(points[:, Y]) == np.diff(points[:, Y])[0]), "one point a row, in order"
    # The brighter side, here to the right in the image, is on the right of the way: upwards.
    assert points[0, Y] > points[-1, Y]


def test_where_every_pixel_is_an_edge_there_is_room_for_all() -> None:
    y, x = np.indices((120, 160))
    board = np.where((x // 2 + y // 2) % 2, 255, 0).astype(np.uint8)
    gradient = gradient_of(board, 1.0)
    marks, seeds = mark_edges(gradient.dx, gradient.dy, 0.5, 0.5)
    assert len(seeds) == (marks == 2).sum() > 0.9 * board.size
    cells, starts = link_edges(gradient.dx, gradient.dy, marks, seeds, 2)
    assert len(np.unique(cells)) == len(cells) == starts[-1]


def test_every_step_of_a_chain_can_be_a_piece() -> None:
    zigzag = np.column_stack([np.arange(50.0), 10.0 * (np.arange(50) % 2)])
    pieces = split_chains(zigzag, np.array([0, 50], np.int32), 1.2, 1.0)
    assert sorted(map(tuple, pieces.tolist())) == [(at, at + 1) for at in range(49)]


def test_a_chain_is_cut_at_its_corner() -> None:
    leg = np.arange(41.0)
    corner = np.concatenate([np.column_stack([leg, 0 * leg]), np.column_stack([0 * leg + 40, leg])[1:]])
    pieces = split_chains(corner, np.array([0, 81], np.int32), 1.2, 12.0)
    assert sorted(map(tuple, pieces.tolist())) == [(0, 40), (40, 80)]
    assert len(split_chains(corner, np.array([0, 81], np.int32), 1.2, 50.0)) == 0


def test_fragments_are_joined_where_the_edge_goes_on_and_only_there() -> None:
    rng, levels = np.random.default_rng(2), halves()
    # A stretch of weaker contrast, below the threshold for edges, and one without any.
    weak, gone = levels.copy(), levels.copy()
    weak[34:46] = 60.0 + 0.5 * (levels[34:46] - 60.0)
    gone[34:46] = 60.0
    config = EdgeConfig(low_least=25.0)
    for image, count in ((weak, 1), (gone, 2)):
        lines = find_edges(grey(image, rng), PLAIN, config)
        upright = np.abs(lines.ideal_px[:, 0, 0] - lines.ideal_px[:, 1, 0]) < 1.0
        assert upright.sum() == count


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_points_are_undistorted_as_the_camera_does_it(camera: Camera) -> None:
    raw = np.random.default_rng(3).uniform([0.0, 0.0], [639.0, 479.0], (500, 2))
    np.testing.assert_allclose(straighten(raw, camera), camera.undistort(raw) * camera.focal_px, atol=0.02)


def test_drawn_edges_are_found_and_their_deviations_are_honest() -> None:
    rng, rows = np.random.default_rng(4), []
    for _ in range(60):
        edge = draw_edge(rng)
        lines = find_edges(edge.image, PLAIN, EdgeConfig())
        miss = miss_of(edge, lines.ideal_px)
        assert miss is not None
        assert miss.sense == 1.0, "the brighter side is on the right"
        rows.append(
            [
                miss.offset_px,
                miss.offset_px / lines.sigma_middle_px[miss.row],
                miss.angle_rad / lines.sigma_angle_rad[miss.row],
            ]
        )
    offset, *scaled = np.array(rows).T
    assert np.median(np.abs(offset)) < 0.01
    # Sixty squares of a standard normal average to 1 with a deviation of 0.18.
    assert all(0.5 < np.mean(value**2) < 1.8 for value in scaled)


@pytest.mark.parametrize(
    ("scale", "shift", "blur", "noise"),
    [(0.15, 5.0, 0.7, 1.0), (1.0, 0.0, 0.7, 8.0), (1.0, 0.0, 2.5, 2.0), (2.5, 60.0, 0.7, 2.0)],
    ids=["dark", "noisy", "blurred", "over-exposed"],
)
def test_an_edge_is_found_in_bad_light(scale: float, shift: float, blur: float, noise: float) -> None:
    levels = halves(100.0, 40.0, blur=blur) * scale + shift
    lines = find_edges(grey(levels, np.random.default_rng(5), noise), PLAIN, EdgeConfig())
    length = np.linalg.norm(lines.ideal_px[:, 1] - lines.ideal_px[:, 0], axis=1)
    longest = lines.ideal_px[length.argmax()]
    assert length.max() > 55.0
    # Clipping cuts an edge off on one side, and so moves it.
    assert np.abs(longest[:, 0] - 50.0).max() < 0.5


def test_noise_alone_makes_hardly_any_line() -> None:
    rng = np.random.default_rng(6)
    for noise in (1.0, 4.0, 12.0):
        lines = find_edges(grey(np.full((480, 640), 120.0), rng, noise), PLAIN, EdgeConfig())
        length = np.linalg.norm(lines.ideal_px[:, 1] - lines.ideal_px[:, 0], axis=1)
        assert (length >= 20.0).sum() <= 2
