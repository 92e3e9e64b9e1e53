"""Calibration boards, plain and with markers: finding their inner corners in an image, to a part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from maps.poses import Array, frozen
from vision.images import GreyImage

#: Names of the marker dictionaries that OpenCV knows, without their prefix: "5X5_100".
DICTIONARIES = tuple(sorted({name[5:].upper() for name in dir(cv2.aruco) if name.startswith("DICT_")}))

#: Boards are looked for in a picture no longer than this; a larger one brings time, and no board.
SEARCH_PX = 1000


@dataclass(frozen=True, slots=True)
class RefinementConfig:
    """How corners are refined (Foerstner and Guelch 1987, OpenCV's cornerSubPix).

    A larger window averages more noise away, until it meets other edges of the board or the lens bends
    the edges in it. `window_share`: half the window, of what one square measures around that corner; on
    photographs the residuals are smallest from 0.3 to 0.35, and leap up from 0.4.
    """

    window_share: float = 0.3
    #: Half the window, for every corner of every view; None takes its share of the square.
    window_px: int | None = None
    iterations: int = 50
    epsilon_px: float = 1e-3


#: Of what is clear around a corner, so much is looked at.
_CLEAR = 0.9
#: Half the window of a refinement at least; and at most, as a share of the image's longer side: so far, a lens
#: does not bend edges yet.
_MOST = 0.02
_LEAST_PX = 2


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """N corners of a board in one image.

    `board_m`: (N, 3) metres on the board, z zero; `image_px`: (N, 2) raw pixels. Arrays are read-only.
    """

    board_m: Array
    image_px: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "board_m", frozen(self.board_m))
        object.__setattr__(self, "image_px", frozen(self.image_px))

    def __len__(self) -> int:
        return len(self.image_px)


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard by its inner corners: one less than squares, in each direction."""

    columns: int
    rows: int
    square_m: float

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares."""
        return self.columns + 1, self.rows + 1

    @property
    def corners_m(self) -> Array:
        """All its inner corners row by row, (n, 3), metres from its first outer corner."""
        return _grid(self.columns, self.rows, self.square_m)

    @property
    def clear_share(self) -> float:
        """How far around a corner there is nothing but its own edges, in squares."""
        return 1.0

    def find(self, image: GreyImage) -> Corners | None:
        """Find all its corners, roughly."""
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, points = cv2.findChessboardCorners(image, (self.columns, self.rows), flags=flags)
        if not found or points is None or len(points) != self.columns * self.rows:
            return None
        return Corners(self.corners_m, _pixels(points))


@dataclass(frozen=True, slots=True)
class Charuco:
    """A chessboard with markers in its light squares, by its squares; parts of it can be used."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares."""
        return self.columns, self.rows

    @property
    def corners_m(self) -> Array:
        """All its inner corners row by row, (n, 3), metres from its first outer corner."""
        return _grid(self.columns - 1, self.rows - 1, self.square_m)

    @property
    def clear_share(self) -> float:
        """How far around a corner there is nothing but its own edges, in squares: up to the markers."""
        return 0.5 * (1.0 - self.marker_m / self.square_m)

    def pattern(self, legacy: bool = False) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board; `legacy` as before version 4.6, which differs where rows are even."""
        dictionary = _dictionary(self.dictionary)
        board = cv2.aruco.CharucoBoard(self.squares, self.square_m, self.marker_m, dictionary)
        board.setLegacyPattern(legacy)
        return board

    def find(self, image: GreyImage) -> Corners | None:
        """Find those of its corners that lie between markers, roughly."""
        for legacy in (False, True) if self.rows % 2 == 0 else (False,):
            points, names, _, _ = cv2.aruco.CharucoDetector(self.pattern(legacy)).detectBoard(image)
            if points is not None and names is not None and len(names):
                return Corners(self.corners_m[np.asarray(names).ravel()], _pixels(points))
        return None


Board = Chessboard | Charuco


def markers_in(dictionary: str) -> int:
    """Return how many different markers a dictionary has."""
    return len(_dictionary(dictionary).bytesList)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def find_corners(image: GreyImage, board: Board, config: RefinementConfig) -> Corners | None:
    """Find a board's corners and refine them; None where there is no board."""
    scale = max(1.0, max(image.shape) / SEARCH_PX)
    if min(image.shape) / scale < 3 * max(board.squares):
        return None
    if scale == 1.0:
        found = board.find(image)
        return None if found is None else _refined(image, found, board, config)
    height, width = (round(length / scale) for length in image.shape)
    small = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    found = find_corners(small, board, RefinementConfig())
    if found is None:
        return None
    points = (found.image_px + 0.5) * (np.array(image.shape[::-1]) / [width, height]) - 0.5
    return _refined(image, Corners(found.board_m, points), board, config)


def _refined(image: GreyImage, corners: Corners, board: Board, config: RefinementConfig) -> Corners:
    share = min(config.window_share, _CLEAR * board.clear_share)
    halves = share * square_sizes_px(corners, board.square_m)
    halves = np.clip(halves, _LEAST_PX, max(_LEAST_PX, _MOST * max(image.shape)))
    if config.window_px is not None:
        halves[:] = config.window_px
    halves = np.minimum(halves, (min(image.shape) - 5) // 2).astype(int)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, config.iterations, config.epsilon_px)
    refined = np.clip(corners.image_px, 0.0, np.array(image.shape[::-1]) - 1.0)
    for half in np.unique(halves).tolist():
        which = halves == half
        points = refined[which].astype(np.float32)
        refined[which] = cv2.cornerSubPix(image, points, (half, half), (-1, -1), criteria).reshape(-1, 2)
    return Corners(corners.board_m, refined)


def square_sizes_px(corners: Corners, square_m: float) -> Array:
    """Return what one square measures around each corner (N,), in the direction in which it is shortest."""
    image = np.linalg.norm(corners.image_px[:, None] - corners.image_px, axis=2)
    board = np.linalg.norm(corners.board_m[:, None] - corners.board_m, axis=2)
    apart = board > 0.0
    pixels_per_metre = np.full(image.shape, np.inf)
    pixels_per_metre[apart] = image[apart] / board[apart]
    sizes: Array = square_m * pixels_per_metre.min(axis=1)
    return sizes


def _pixels(points: cv2.typing.MatLike) -> Array:
    """Return points as OpenCV gives them, in one of three shapes, as (N, 2)."""
    return np.asarray(points, np.float64).reshape(-1, 2)


def _grid(columns: int, rows: int, square_m: float) -> Array:
    x, y = np.meshgrid(np.arange(1.0, columns + 1.0), np.arange(1.0, rows + 1.0))
    return frozen(square_m * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
