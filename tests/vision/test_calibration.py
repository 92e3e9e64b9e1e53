"""Calibration: drawn cameras recovered, useless views left out and named, poor sets refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boardviews import BARREL, FISHEYE, corner_views, draw_board, poses

from maps.poses import Array
from vision.boards import Board, Charuco, Chessboard, Corners, RefinementConfig, find_corners
from vision.calibration import Calibration, CalibrationConfig, Unconstrained, ViewFault, calibrate
from vision.camera import Camera, CameraModel
from vision.images import read_image

BOARD = Chessboard(7, 5, 0.03)
CONFIG = CalibrationConfig()
SIZE = (320, 240)


def calibrated(camera: Camera, views: dict[str, Corners], config: CalibrationConfig = CONFIG) -> Calibration:
    result = calibrate(views, SIZE, camera.model, config)
    assert isinstance(result, Calibration), result.why
    return result


def refused(views: dict[str, Corners], model: CameraModel = BARREL.model) -> Unconstrained:
    result = calibrate(views, SIZE, model, CONFIG)
    assert isinstance(result, Unconstrained)
    return result


def seen(
    camera: Camera, count: int = 8, seed: int = 0, tilt: float = 0.6, noise: float = 0.04
) -> dict[str, Corners]:
    return corner_views(camera, BOARD, count, np.random.default_rng(seed), noise, tilt)


def in_sigmas(result: Calibration, camera: Camera) -> Array:
    """Return how many standard deviations each of the eight or nine parameters is off."""
    found, true = (
        np.array([each.fx, each.fy, each.cx, each.cy, *each.distortion]) for each in (result.camera, camera)
    )
    return np.abs(found - true) / np.maximum(result.deviations, 1e-12)


@pytest.mark.parametrize(
    ("camera", "board"),
    [
        (BARREL, BOARD),
        (FISHEYE, BOARD),
        (BARREL, Charuco(6, 5, 0.04, 0.028, "4X4_50")),
        (FISHEYE, Charuco(6, 5, 0.04, 0.028, "4X4_50")),
    ],
    ids=["barrel", "fisheye", "barrel-charuco", "fisheye-charuco"],
)
def test_a_drawn_camera_is_recovered(camera: Camera, board: Board) -> None:
    rng = np.random.default_rng(4)
    views = {}
    for index, pose in enumerate(poses(camera, board, 10, rng)):
        corners = find_corners(draw_board(camera, board, pose, rng), board, RefinementConfig())
        if corners is not None:
            views[f"{index}.png"] = corners
    result = calibrated(camera, views)
    assert result.rms_px < 0.15
    assert result.camera.model is camera.model
    assert in_sigmas(result, camera).max() < 4.0
    assert result.deviations[:2].max() < 0.01 * camera.fx


def test_what_the_views_do_not_show_stays_at_zero_and_uncertain() -> None:
    result = calibrated(BARREL, seen(BARREL))
    assert result.camera.distortion[4] == 0.0 < result.deviations[8]
    everything = calibrated(BARREL, seen(BARREL), replace(CONFIG, significance=0.0))
    assert everything.camera.distortion[4] != 0.0
    assert everything.rms_px <= result.rms_px
    strong = replace(BARREL, distortion=np.array([-0.3, 0.3, 0.0, 0.0, -0.6]))
    shown = calibrated(strong, seen(strong, count=12, noise=0.005))
    assert shown.camera.distortion[4] == pytest.approx(-0.6, abs=0.2)


def test_square_pixels() -> None:
    result = calibrated(BARREL, seen(BARREL), replace(CONFIG, square_pixels=True))
    assert result.camera.fx == result.camera.fy == pytest.approx(269.5, abs=1.5)


def test_a_view_that_does_not_fit_is_left_out() -> None:
    views = seen(BARREL)
    spoilt = views["view3"].image_px + np.random.default_rng(1).normal(0.0, 2.0, (35, 2))
    views["view3"] = Corners(BOARD.corners_m, spoilt)
    result = calibrated(BARREL, views)
    assert result.rejected == {"view3": ViewFault.LARGE_RESIDUALS}
    assert set(result.used) == set(result.residuals_px) == set(views) - {"view3"}
    assert in_sigmas(result, BARREL).max() < 4.0


def test_a_view_a_little_worse_than_perfect_ones_is_kept() -> None:
    views = seen(BARREL, noise=0.005)
    views["view3"] = Corners(BOARD.corners_m, views["view3"].image_px + 0.05 * np.eye(35, 2))
    assert calibrated(BARREL, views).rejected == {}


def test_repeated_views_and_views_of_few_corners_count_for_nothing() -> None:
    views = seen(BARREL, count=5)
    first, row = views["view0"], views["view1"]
    views["again"] = Corners(first.board_m, first.image_px + 0.5)
    views["few"] = Corners(first.board_m[:7], first.image_px[:7])
    views["row"] = Corners(row.board_m[:7].repeat(2, axis=0), row.image_px[:7].repeat(2, axis=0))
    result = calibrated(BARREL, views)
    assert result.rejected == {
        "again": ViewFault.REPEATED,
        "few": ViewFault.FEW_CORNERS,
        "row": ViewFault.FEW_CORNERS,
    }


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_views_are_refused(count: int) -> None:
    assert refused(seen(BARREL, count=count)).why == f"usable views: {count}, and at least 3 are needed"


def test_one_view_many_times_is_refused() -> None:
    one = seen(BARREL, count=1)["view0"]
    views = {str(index): Corners(one.board_m, one.image_px + 0.1 * index) for index in range(8)}
    assert list(refused(views).rejected.values()) == [ViewFault.REPEATED] * 7


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
@pytest.mark.parametrize(("tilt", "noise"), [(0.0, 0.04), (0.02, 0.04), (0.02, 0.4)])
def test_views_straight_on_are_refused(camera: Camera, tilt: float, noise: float) -> None:
    why = refused(seen(camera, 6, 1, tilt, noise), camera.model).why
    assert "leave" in why
    assert "tilt the board" in why


@pytest.mark.parametrize("model", list(CameraModel))
def test_nonsense_is_refused_or_warned_of(model: CameraModel) -> None:
    rng = np.random.default_rng(0)
    views = {str(n): Corners(BOARD.corners_m, rng.uniform(0, 240, (35, 2))) for n in range(6)}
    result = calibrate(views, SIZE, model, CONFIG)
    assert isinstance(result, Unconstrained) or any("residuals" in warning for warning in result.warnings)


def test_borders_without_corners_are_warned_of() -> None:
    assert calibrated(BARREL, seen(BARREL, count=40)).warnings == ()
    views = seen(BARREL, count=30)
    left = {name: view for name, view in views.items() if view.image_px[:, 0].max() < 240}
    assert len(left) >= 4
    borders = [warning for warning in calibrated(BARREL, left).warnings if "right border" in warning]
    assert len(borders) == 1


def test_a_lens_that_sees_more_than_half_the_world_is_warned_of() -> None:
    # The picture's corners are 92 degrees off the axis, where a plane of rays has no place for them.
    warnings = calibrated(FISHEYE, seen(FISHEYE, count=12)).warnings
    assert any("cannot be undistorted" in warning for warning in warnings)


def test_the_wrong_lens_model_is_warned_of() -> None:
    wide = replace(FISHEYE, fx=90.0, fy=90.0)
    rng = np.random.default_rng(0)
    result = calibrate(corner_views(wide, BOARD, 12, rng, 0.03), SIZE, CameraModel.PINHOLE_RADTAN, CONFIG)
    assert isinstance(result, Unconstrained) or result.warnings


def test_published_photographs(data: Path) -> None:
    board = Chessboard(9, 6, 0.025)
    images = {
        path.name: read_image(path) for path in sorted((data / "chessboards_open/images").glob("*.jpg"))
    }

    def result(corners: RefinementConfig, fit: CalibrationConfig) -> Calibration:
        views = {name: find_corners(image, board, corners) for name, image in images.items()}
        found = {name: view for name, view in views.items() if view is not None}
        answer = calibrate(found, (640, 480), CameraModel.PINHOLE_RADTAN, fit)
        assert isinstance(answer, Calibration)
        assert len(answer.used) == 13
        return answer

    # As OpenCV's own sample does it: a fixed window, square pixels, every coefficient and every view.
    published = result(
        RefinementConfig(window_px=11, iterations=30, epsilon_px=0.1),
        CalibrationConfig(square_pixels=True, significance=0.0, outlier_ratio=100.0),
    )
    assert published.camera.fx == pytest.approx(535.92, abs=0.05)
    assert published.rms_px == pytest.approx(0.3926, abs=0.001)
    ours = result(RefinementConfig(), CONFIG)
    assert ours.rms_px < 0.19
    # An independent calibration with corners found in smaller windows, within its bootstrap's deviations.
    found = [ours.camera.fx, ours.camera.fy, ours.camera.cx, ours.camera.cy]
    np.testing.assert_array_less(
        np.abs(np.subtract(found, [532.83, 532.95, 342.49, 233.86])), [1.2, 1.2, 2.4, 2.4]
    )
