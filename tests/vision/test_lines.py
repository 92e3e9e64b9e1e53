"""Lines found in pictures: where they were drawn, also through a lens; and pictures that are none."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE, draw, exact_lines
from toy_building import toy_building

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from tests.drawnedges import covered_px
from vision.camera import Camera
from vision.images import GreyImage
from vision.lines import LineConfig, LineMethod, extract_segments
from vision.projection import Projector


def step_edge(angle: float, offset: float, rng: np.random.Generator) -> GreyImage:
    """A dark and a bright half, 200 x 200, that meet at the line n . (pixel - 100) = offset."""
    fine = (np.arange(1600) + 0.5) / 8.0 - 0.5
    bright = np.cos(angle) * (fine - 100) + (np.sin(angle) * (fine - 100))[:, None] > offset
    image = cv2.resize(np.where(bright, 200.0, 60.0), (200, 200), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0.0, 1.5, image.shape)
    grey: GreyImage = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return grey


def off_px(pieces: Array, lines: Array) -> Array:
    """How far the ends of lines (M, 2, 2) lie from the nearest of pieces (P, 2, 2) beside their middles, (M,)."""
    way = pieces[:, 1] - pieces[:, 0]
    length = np.linalg.norm(way, axis=1)
    way = way / length[:, None]
    ends = lines[:, None] - pieces[:, :1]
    across = ends[..., 0] * way[:, None, 1] - ends[..., 1] * way[:, None, 0]
    reach = (ends.mean(axis=2) * way).sum(axis=2)
    rms = np.sqrt((across**2).mean(axis=2))
    result: Array = np.where((reach > 0.0) & (reach < length), rms, np.inf).min(axis=1)
    return result


def ideal(raw: Array) -> Array:
    return raw - [CAMERA.cx, CAMERA.cy]


@pytest.mark.parametrize("method", LineMethod)
def test_an_edge_is_found_where_it_is_on_average_too(method: LineMethod) -> None:
    rng = np.random.default_rng(3)
    normals, misses = [], []
    for _ in range(25):
        angle, offset = rng.uniform(-np.pi, np.pi), rng.uniform(-20.0, 20.0)
        found = extract_segments(step_edge(angle, offset, rng), CAMERA, LineConfig(method=method))
        longest = found.raw_px[found.lengths_px.argmax()]
        assert np.linalg.norm(longest[1] - longest[0]) > 120.0
        assert longest[0, 0] <= longest[1, 0]
        normal = np.array([np.cos(angle), np.sin(angle)])
        across = (longest - 100.0) @ normal - offset
        assert np.abs(across).max() < (0.75 if method is LineMethod.HOUGH else 0.3)
        normals.append(normal)
        misses.append(across.mean())
    # A shift of all lines alike would turn every fix: it must be far below the noise of a line.
    shift = np.linalg.lstsq(np.array(normals), np.array(misses), rcond=None)[0]
    assert np.abs(shift).max() < (0.15 if method is LineMethod.HOUGH else 0.02)


def test_without_distortion_ideal_pixels_are_raw_ones_about_the_principal_point() -> None:
    found = extract_segments(step_edge(0.3, 4.0, np.random.default_rng(0)), CAMERA, LineConfig())
    np.testing.assert_allclose(found.ideal_px, ideal(found.raw_px), atol=1e-9)
    assert (found.sigma_px > LineConfig().sigma_px).all()
    assert not found.ideal_px.flags.writeable


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
def test_edges_of_a_drawn_room_are_found_within_a_third_of_a_pixel(camera: Camera, toy_map: WireMap) -> None:
    pose = Pose2(2.0, 5.5, -0.9)
    image = draw(toy_building().faces, camera, pose, np.random.default_rng(0))
    found = extract_segments(image, camera, LineConfig())
    predicted = Projector(camera, toy_map).predict(pose, np.arange(len(toy_map)))
    off = off_px(predicted.ideal_px, found.ideal_px[found.lengths_px > 60.0])
    off = off[off < 3.0]
    assert len(off) > 15
    assert np.median(off) < 0.1
    assert np.quantile(off, 0.9) < 0.3


def test_short_lines_are_left_out() -> None:
    image = step_edge(0.3, 4.0, np.random.default_rng(0))
    assert len(extract_segments(image, CAMERA, LineConfig(min_length_px=500.0))) == 0


@pytest.mark.parametrize("method", LineMethod)
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_constant_image_has_no_lines(level: int, method: LineMethod) -> None:
    image = np.full((480, 640), level, np.uint8)
    found = extract_segments(image, CAMERA, LineConfig(method=method))
    assert len(found) == 0
    assert found.raw_px.shape == found.ideal_px.shape == (0, 2, 2)
    assert found.lengths_px.shape == (0,)


@pytest.mark.parametrize("method", LineMethod)
@pytest.mark.parametrize("shape", [(0, 0), (0, 640), (480, 0), (1, 1), (2, 3), (1, 640), (5, 5), (8, 640)])
def test_tiny_images_have_no_lines(shape: tuple[int, int], method: LineMethod) -> None:
    noise = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    for image in (np.full(shape, 99, np.uint8), noise):
        assert len(extract_segments(image, BARREL, LineConfig(method=method))) == 0


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
@pytest.mark.parametrize("method", LineMethod)
def test_patterns_of_extremes_give_finite_lines(method: LineMethod, camera: Camera) -> None:
    y, x = np.indices((480, 640))
    noise = np.random.default_rng(0).integers(0, 2, (480, 640))
    for pattern in (noise, (x // 2 + y // 2) % 2, (x // 3) % 2, ((x + y) // 3) % 2):
        image = np.where(pattern, 255, 0).astype(np.uint8)
        found = extract_segments(image, camera, LineConfig(method=method))
        assert np.isfinite(found.raw_px).all()
        assert np.isfinite(found.ideal_px).all()
        assert (found.sigma_px > 0.0).all()
        assert (found.sigma_angle_rad > 0.0).all()


@pytest.mark.parametrize("method", LineMethod)
def test_a_saturated_half_is_one_long_line(method: LineMethod) -> None:
    image = np.full((200, 200), 128, np.uint8)
    image[:, 100:] = 255
    found = extract_segments(cv2.GaussianBlur(image, (0, 0), 0.7), CAMERA, LineConfig(method=method))
    assert len(found) == 1
    assert found.lengths_px[0] > 180.0
    assert np.abs(found.raw_px[0, :, 0] - 99.5).max() < 0.6


@pytest.mark.parametrize("method", LineMethod)
def test_twelve_megapixels_are_searched_too(method: LineMethod) -> None:
    image = np.full((3000, 4000), 60, np.uint8)
    cv2.rectangle(image, (700, 500), (3300, 2500), 200, -1)
    camera = replace(CAMERA, width=4000, height=3000, fx=3400.0, fy=3400.0, cx=1999.5, cy=1499.5)
    found = extract_segments(image, camera, LineConfig(method=method))
    assert found.lengths_px.max() > 2500.0
    assert np.sort(found.lengths_px)[-4:].min() > 1900.0


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_the_papers_extractor_straightens_what_the_lens_bends(camera: Camera, toy_map: WireMap) -> None:
    pose = Pose2(2.0, 5.5, -0.9)
    image = draw(toy_building().faces, camera, pose, np.random.default_rng(0))
    found = extract_segments(image, camera, LineConfig(method=LineMethod.HOUGH))
    predicted = Projector(camera, toy_map).predict(pose, np.arange(len(toy_map)))
    seen, covered = covered_px(predicted.ideal_px, found.ideal_px, aside_px=1.0, turn_deg=2.0)
    assert covered > 0.5 * seen
    again = camera.undistort(found.raw_px.reshape(-1, 2)).reshape(-1, 2, 2) * camera.focal_px
    np.testing.assert_allclose(again, found.ideal_px, atol=0.02)


@pytest.mark.parametrize("method", LineMethod)
def test_polarity_and_contrast_are_those_of_the_edge(method: LineMethod) -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        angle = rng.uniform(-np.pi, np.pi)
        found = extract_segments(step_edge(angle, 2.0, rng), CAMERA, LineConfig(method=method))
        longest = found[found.lengths_px.argmax(keepdims=True)]
        along = longest.raw_px[0, 1] - longest.raw_px[0, 0]
        # The step is brighter where n . pixel is larger, n = (cos, sin).
        right = np.array([-along[1], along[0]])
        assert longest.polarity[0] == np.sign(right @ [np.cos(angle), np.sin(angle)])
        assert abs(longest.contrast[0] - 140.0) < 10.0


def test_some_segments_are_picked_with_all_that_is_known_of_them() -> None:
    found = extract_segments(step_edge(0.3, 4.0, np.random.default_rng(0)), CAMERA, LineConfig())
    none = found[np.zeros(len(found), bool)]
    assert len(none) == len(none.polarity) == len(none.contrast) == len(none.sigma_angle_rad) == 0
    assert len(found[np.array([0])]) == 1


def test_exact_lines_of_the_tests_agree_with_the_cameras_own_undistortion(toy_map: WireMap) -> None:
    predicted = Projector(BARREL, toy_map).predict(Pose2(2.0, 5.5, -0.9), np.arange(len(toy_map)))
    lines = exact_lines(BARREL, predicted)
    again = BARREL.undistort(lines.raw_px.reshape(-1, 2)).reshape(-1, 2, 2) * BARREL.focal_px
    np.testing.assert_allclose(again, lines.ideal_px, atol=1e-3)
