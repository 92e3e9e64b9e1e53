"""Boards in drawn pictures: corners found where they are, to a part of a pixel, and none where there is no board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from boardviews import BARREL, BoardPose, corners_px, draw_board
from hypothesis import given
from hypothesis import strategies as st

from maps.poses import Array
from vision.boards import Board, Charuco, Chessboard, Corners, RefinementConfig, find_corners, square_sizes_px
from vision.images import GreyImage

CHESSBOARD = Chessboard(7, 5, 0.03)
CHARUCO = Charuco(7, 5, 0.04, 0.03, "4X4_50")
POSE = BoardPose(0.4, -0.3, 0.1, (0.01, -0.02, 0.45))
CONFIG = RefinementConfig()


def drawn(board: Board, pose: BoardPose = POSE) -> GreyImage:
    return draw_board(BARREL, board, pose, np.random.default_rng(0))


def errors_px(found: Corners | None, board: Board, pose: BoardPose = POSE) -> Array:
    """Return each corner's distance from where its place on the board truly is in the picture."""
    assert found is not None
    rows = [int(np.flatnonzero((board.corners_m == corner).all(axis=1))[0]) for corner in found.board_m]
    return np.linalg.norm(found.image_px - corners_px(BARREL, board, pose)[rows], axis=1)


def test_chessboard_corners_are_found_to_a_fraction_of_a_pixel() -> None:
    errors = errors_px(find_corners(drawn(CHESSBOARD), CHESSBOARD, CONFIG), CHESSBOARD)
    assert len(errors) == 35
    assert np.sqrt((errors**2).mean()) < 0.08
    assert errors.max() < 0.25


def test_charuco_corners_are_found_to_a_fraction_of_a_pixel() -> None:
    errors = errors_px(find_corners(drawn(CHARUCO), CHARUCO, CONFIG), CHARUCO)
    assert len(errors) >= 20
    assert np.sqrt((errors**2).mean()) < 0.15
    assert errors.max() < 0.4


def test_part_of_a_charuco_board_is_enough_but_not_of_a_chessboard() -> None:
    cut = drawn(CHARUCO)
    cut[:, 160:] = 120
    errors = errors_px(find_corners(cut, CHARUCO, CONFIG), CHARUCO)
    assert 4 <= len(errors) < 20
    assert errors.max() < 0.4
    cut = drawn(CHESSBOARD)
    cut[:, 160:] = 120
    assert find_corners(cut, CHESSBOARD, CONFIG) is None


def test_boards_with_an_even_number_of_rows_are_found_in_both_of_opencvs_orders() -> None:
    board = Charuco(7, 6, 0.04, 0.03, "4X4_50")
    for legacy in (False, True):
        picture = board.pattern(legacy).generateImage((7 * 40, 6 * 40))
        found = find_corners(np.asarray(np.pad(picture, 30, constant_values=255), np.uint8), board, CONFIG)
        assert found is not None
        # The picture's pixel (0, 0) lies 30.5 pixels right of and below the board's corner.
        np.testing.assert_allclose(found.image_px, found.board_m[:, :2] / 0.04 * 40.0 + 29.5, atol=0.3)
        assert len(found) == 30


def test_a_large_picture_is_searched_small_and_measured_large() -> None:
    picture = drawn(CHESSBOARD)
    small = find_corners(picture, CHESSBOARD, CONFIG)
    large = find_corners(
        np.asarray(cv2.resize(picture, None, fx=6.0, fy=6.0, interpolation=cv2.INTER_CUBIC), np.uint8),
        CHESSBOARD,
        CONFIG,
    )
    assert small is not None
    assert large is not None
    back = (large.image_px + 0.5) / 6.0 - 0.5
    np.testing.assert_allclose(back, small.image_px, atol=0.15)


def test_the_window_shrinks_with_the_board() -> None:
    # A window wider than the squares of this small board would pull corners towards their neighbours.
    far = BoardPose(0.2, 0.1, 0.7, (0.0, 0.0, 1.2))
    picture = drawn(CHESSBOARD, far)
    wide = RefinementConfig(window_px=11)
    adapted = errors_px(find_corners(picture, CHESSBOARD, CONFIG), CHESSBOARD, far)
    pulled = errors_px(find_corners(picture, CHESSBOARD, wide), CHESSBOARD, far)
    assert adapted.max() < 0.3 < 1.0 < pulled.max()


@pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO], ids=["chessboard", "charuco"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 700), (700, 1), (20, 20), (120, 160)])
@pytest.mark.parametrize("level", [0, 128, 255, None])
def test_no_board_is_found_where_there_is_none(
    board: Board, shape: tuple[int, int], level: int | None
) -> None:
    noise = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    image = noise if level is None else np.full(shape, level, np.uint8)
    assert find_corners(image, board, CONFIG) is None
    assert find_corners(image, board, RefinementConfig(window_px=50)) is None


def test_another_board_is_not_found() -> None:
    assert find_corners(drawn(CHESSBOARD), Chessboard(8, 5, 0.03), CONFIG) is None
    assert find_corners(drawn(CHESSBOARD), CHARUCO, CONFIG) is None
    assert find_corners(drawn(CHARUCO), Charuco(5, 7, 0.04, 0.03, "4X4_50"), CONFIG) is None


@given(st.floats(5.0, 80.0), st.floats(0.2, 1.0), st.sets(st.integers(0, 34), min_size=2))
def test_square_sizes_are_those_of_the_shorter_side_gaps_or_not(
    size_px: float, squeeze: float, kept: set[int]
) -> None:
    board_m = CHESSBOARD.corners_m[sorted(kept)]
    image_px = board_m[:, :2] / CHESSBOARD.square_m * [size_px, squeeze * size_px]
    sizes = square_sizes_px(Corners(board_m, image_px), CHESSBOARD.square_m)
    assert (sizes >= squeeze * size_px - 1e-9).all()
    assert (sizes <= size_px + 1e-9).all()
    if len(kept) == 35:
        np.testing.assert_allclose(sizes, squeeze * size_px)
