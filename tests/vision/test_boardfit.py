"""The least squares behind a calibration: derivatives, agreement with OpenCV, honest deviations."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from boardviews import BARREL, FISHEYE, corner_views

from maps.poses import Array
from vision.boardfit import COEFFICIENTS, fit_boards, project
from vision.boards import Chessboard
from vision.camera import Camera, CameraModel

BOARD = Chessboard(7, 5, 0.03)
CAMERAS = pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])


def parameters_of(camera: Camera) -> Array:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def free(model: CameraModel) -> Array:
    return np.eye(4 + COEFFICIENTS[model])


@CAMERAS
def test_derivatives_are_those_of_the_projection(camera: Camera) -> None:
    parameters, pose = parameters_of(camera), np.array([0.3, -0.4, 0.2, -0.05, 0.03, 0.4])
    pixels, by_parameters, by_pose = project(BOARD.corners_m, parameters, pose, camera.model)
    for index, step in enumerate([*np.maximum(1e-6 * np.abs(parameters), 1e-7), *np.full(6, 1e-7)]):
        moved = np.concatenate([parameters, pose])
        moved[index] += step
        other = project(BOARD.corners_m, moved[:-6], moved[-6:], camera.model)[0]
        slope = np.hstack([by_parameters, by_pose])[:, index]
        np.testing.assert_allclose((other - pixels).ravel() / step, slope, rtol=1e-3, atol=1e-2)


@CAMERAS
def test_exact_corners_give_the_exact_camera(camera: Camera) -> None:
    views = corner_views(camera, BOARD, 6, np.random.default_rng(0), noise=0.0)
    fit = fit_boards(list(views.values()), (camera.width, camera.height), camera.model, free(camera.model))
    assert fit is not None
    np.testing.assert_allclose(fit.parameters, parameters_of(camera), rtol=1e-4, atol=1e-4)
    assert max(np.abs(part).max() for part in fit.residuals_px) < 1e-4


@CAMERAS
def test_deviations_are_honest(camera: Camera) -> None:
    errors = []
    for seed in range(12):
        views = corner_views(camera, BOARD, 8, np.random.default_rng(seed), noise=0.05)
        fit = fit_boards(
            list(views.values()), (camera.width, camera.height), camera.model, free(camera.model)
        )
        assert fit is not None
        errors.append((fit.parameters - parameters_of(camera)) / fit.deviations)
    # The larger of two estimates: rather too large.
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.15
    assert np.abs(errors).max() < 4.5


def test_what_opencv_minimises_is_minimised_and_its_deviations_are_no_larger() -> None:
    views = list(corner_views(BARREL, BOARD, 8, np.random.default_rng(3), noise=0.1).values())
    fit = fit_boards(views, (320, 240), BARREL.model, free(BARREL.model))
    assert fit is not None
    boards = [view.board_m.astype(np.float32) for view in views]
    images = [view.image_px.astype(np.float32) for view in views]
    rms, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(
        boards, images, (320, 240), np.eye(3), np.zeros(5),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    )  # fmt: skip
    theirs = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()]
    np.testing.assert_allclose(fit.parameters, theirs, rtol=1e-3, atol=1e-4)
    residuals = np.concatenate(fit.residuals_px)
    assert np.sqrt((residuals**2).sum(axis=1).mean()) == pytest.approx(rms, rel=1e-5)
    assert (fit.deviations >= deviations.ravel()[:9] * 0.999).all()


def test_errors_that_a_view_shares_make_the_deviations_grow() -> None:
    # The corners of each view are bent alike, as on a board that is not flat: nothing of it averages out.
    views = corner_views(BARREL, BOARD, 8, np.random.default_rng(5), noise=0.01)
    rng = np.random.default_rng(6)
    bent = [
        type(view)(
            view.board_m, view.image_px + rng.normal(0.0, 20.0, 2) * (view.board_m[:, :1] - 0.1) ** 2 * 30
        )
        for view in views.values()
    ]
    fit = fit_boards(bent, (320, 240), BARREL.model, free(BARREL.model))
    assert fit is not None
    boards, images = ([part.astype(np.float32) for part in parts] for parts in zip(
        *((view.board_m, view.image_px) for view in bent), strict=True))  # fmt: skip
    naive = cv2.calibrateCameraExtended(boards, images, (320, 240), np.eye(3), np.zeros(5))[5].ravel()
    assert np.median(fit.deviations / naive[:9]) > 1.3


def test_a_held_parameter_is_held() -> None:
    views = list(corner_views(BARREL, BOARD, 6, np.random.default_rng(2), noise=0.05).values())
    square = free(BARREL.model)
    square[1, 0] = 1.0
    square = np.delete(square, [1, 8], axis=1)
    fit = fit_boards(views, (320, 240), BARREL.model, square)
    assert fit is not None
    assert fit.parameters[0] == fit.parameters[1]
    assert fit.deviations[0] == fit.deviations[1] > 0.0
    assert fit.parameters[8] == fit.deviations[8] == 0.0


@CAMERAS
def test_one_view_alone_leaves_the_camera_open(camera: Camera) -> None:
    views = list(corner_views(camera, BOARD, 1, np.random.default_rng(2), noise=0.05).values())
    fit = fit_boards(views, (camera.width, camera.height), camera.model, free(camera.model))
    assert fit is None or fit.deviations[:4].max() > 5.0


@pytest.mark.parametrize("focal_px", [70.0, 90.0, 160.0, 400.0])
def test_fisheyes_of_all_widths_are_found(focal_px: float) -> None:
    camera = Camera(
        CameraModel.FISHEYE, 320, 240, focal_px, focal_px, 160.0, 118.0, np.array([0.03, -0.008, 0.002, 0.0]),
        FISHEYE.mount,
    )  # fmt: skip
    views = corner_views(camera, BOARD, 10, np.random.default_rng(1), noise=0.03)
    basis = free(camera.model)[:, :6]
    fit = fit_boards(list(views.values()), (320, 240), camera.model, basis)
    assert fit is not None
    assert fit.parameters[0] == pytest.approx(focal_px, rel=0.02)
    assert max(np.abs(part).max() for part in fit.residuals_px) < 0.5
