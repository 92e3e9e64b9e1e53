"""The line extractor of the paper (section 4.2): contours, Hough transform with limited votes, polygonal pieces.

Nothing is refitted: a line runs from one contour pixel to another, as precise as pixels are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.camera import Camera
from vision.edgelines import EdgeConfig, find_contours
from vision.edgepoints import Cells, pixels_of
from vision.gradient import Gradient
from vision.images import GreyImage
from vision.pieces import members_of, split_chains
from vision.straightening import straighten

#: Standard deviation of a line's end across the line: that of an edge anywhere in its pixel, as drawn edges confirm.
END_SIGMA_PX = 1.0 / math.sqrt(12.0)
#: Pixels farther from the principal point than so many times width plus height, near the rim of a very wide
#: lens, do not vote: the table would be all theirs.
_FAR = 2.0

Votes = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class HoughConfig:
    """How contours become lines; the paper gives no figures."""

    #: Sides of the table's cells: distance from the principal point, and orientation.
    cell_px: float = 1.0
    cell_rad: float = math.radians(2.0)
    #: A pixel votes for lines whose normals are turned by at most this from its gradient.
    range_rad: float = math.radians(10.0)
    #: Shorter chains, lines and pieces are dropped.
    chain_px: float = 20.0
    #: So many pixels in a row of a chain may take themselves for part of another line.
    astray_pixels: int = 3
    #: Contour pixels may lie this far from their side of the polygon.
    straight_px: float = 1.2

    def __post_init__(self) -> None:
        for name in ("cell_px", "cell_rad", "range_rad", "chain_px", "straight_px"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive")

    @property
    def chain_pixels(self) -> int:
        """Fewest pixels of a chain: along a diagonal there is one every 1.4 px."""
        return max(int(0.7 * self.chain_px), 2)


@dataclass(frozen=True, slots=True, eq=False)
class HoughLines:
    """M lines, the brighter side on the right from first to second end: (M, 2, 2) in raw and ideal pixels."""

    raw_px: Array
    ideal_px: Array


def find_hough(image: GreyImage, camera: Camera, config: HoughConfig, canny: EdgeConfig) -> HoughLines:
    """Find the straight contours of a grey image (H, W), straight after undistortion."""
    contours = find_contours(image, canny, config.chain_pixels)
    raw = pixels_of(contours.cells, image.shape[1])
    ideal, normal_rad = oriented(raw, contours.cells, contours.gradient, camera)
    votes = cast_votes(ideal, normal_rad, config, _FAR * sum(image.shape))
    backed = back_votes(ideal, normal_rad, config, votes)
    members, starts = members_of(find_runs(backed, contours.starts, len(votes), config.astray_pixels))
    pieces = split_chains(ideal[members], starts, config.straight_px, config.chain_px)
    ends = members[pieces]
    return HoughLines(raw[ends], ideal[ends])


def oriented(raw: Array, cells: Cells, gradient: Gradient, camera: Camera) -> tuple[Array, Array]:
    """Return contour pixels (Q, 2) as ideal ones, and where their gradients point there, (Q,), radians.

    Undistortion turns directions: that of the contour is taken through it from one pixel's side to the other.
    """
    slopes = np.column_stack([of.ravel()[cells] for of in (gradient.dx, gradient.dy)]).astype(np.float64)
    # With the brighter side on the right.
    along = slopes[:, ::-1] * [1.0, -1.0] / np.linalg.norm(slopes, axis=1, keepdims=True)
    way = straighten(raw + along, camera) - straighten(raw - along, camera)
    return straighten(raw, camera), np.arctan2(way[:, 0], -way[:, 1])


def cast_votes(ideal: Array, normal_rad: Array, config: HoughConfig, far_px: float) -> Votes:
    """Let each pixel vote for the lines through it whose normals are near to its gradient.

    `ideal`: (Q, 2), `normal_rad`: (Q,). Returns the table (orientations, distances) of the lines
    cos(a) u + sin(a) v = d: row 0 is a = 0, the middle column d = 0. Orientations go all around, as a normal
    points to the brighter side: the two edges of a thin bar vote for different lines. Pixels farther from the
    principal point than `far_px`, or nowhere at all, do not vote.
    """
    distance = np.hypot(ideal[:, 0], ideal[:, 1])
    reach = distance[distance <= far_px].max(initial=0.0)
    rows = max(round(math.tau / config.cell_rad), 1)
    votes = np.zeros((rows, 2 * math.ceil(reach / config.cell_px) + 1), np.int32)
    _cast(ideal, normal_rad, config.range_rad, config.cell_px, votes)
    return votes


def back_votes(ideal: Array, normal_rad: Array, config: HoughConfig, votes: Votes) -> NDArray[np.int32]:
    """Return the orientation (row of the table) of the line with most votes among a pixel's own, (Q,).

    -1 where none has as many as a chain has pixels (Gerig, Klein 1986).
    """
    backed: NDArray[np.int32] = _back(
        ideal, normal_rad, config.range_rad, config.cell_px, votes, config.chain_pixels
    )
    return backed


@njit(cache=True, nogil=True)
def find_runs(backed: NDArray[np.int32], starts: Cells, rows: int, astray: int) -> NDArray[np.int32]:
    """Return first and last pixel of each stretch of a chain that backs one line after another, (M, 2).

    Neighbours back the same line where the orientations, of `rows`, differ by no more than one: each line
    passes through its pixel. Up to `astray` pixels in between may back others.
    """
    runs = np.empty((len(backed), 2), np.int32)
    count = 0
    for chain in range(len(starts) - 1):
        at, end = starts[chain], starts[chain + 1]
        while at < end:
            last = at
            for ahead in range(at + 1, end):
                if backed[at] < 0 or ahead - last > astray + 1:
                    break
                turn = abs(backed[ahead] - backed[last])
                if backed[ahead] >= 0 and min(turn, rows - turn) <= 1:
                    last = ahead
            if backed[at] >= 0:
                runs[count, 0], runs[count, 1] = at, last
                count += 1
            at = last + 1
    return runs[:count]


@njit(cache=True, nogil=True)
def _cells(
    x: float,
    y: float,
    normal: float,
    aside: int,
    cell_px: float,
    directions: Array,
    columns: int,
    found: Cells,
) -> int:
    """Number the cells, row after row, of the lines that a pixel votes for; returns how many they are."""
    half, rows = columns // 2, len(directions)
    # What is not a number is not within reach either.
    if not x * x + y * y <= (half * cell_px) ** 2 or not math.isfinite(normal):
        return 0
    # Orientations of a full turn more are positive, as `int` wants them that rounds towards zero.
    first = int(rows * (normal / math.tau + 1.0) + 0.5) - aside + rows
    for number in range(2 * aside + 1):
        row = (first + number) % rows
        distance = (directions[row, 0] * x + directions[row, 1] * y) / cell_px
        found[number] = row * columns + int(distance + half + 0.5)
    return 2 * aside + 1


@njit(cache=True, nogil=True)
def _directions(rows: int) -> Array:
    """Cosine and sine of each row's orientation, (rows, 2)."""
    angles = np.arange(rows) * (math.tau / rows)
    return np.column_stack((np.cos(angles), np.sin(angles)))


@njit(cache=True, nogil=True)
def _aside(range_rad: float, rows: int) -> int:
    """Rows to either side of the gradient's that a pixel votes in: of all rows, at most each once."""
    return min(int(range_rad * rows / math.tau + 0.5), (rows - 1) // 2)


@njit(cache=True, nogil=True)
def _cast(ideal: Array, normal_rad: Array, range_rad: float, cell_px: float, votes: Votes) -> None:
    rows, columns = votes.shape
    directions, aside = _directions(rows), _aside(range_rad, rows)
    found, table = np.empty(rows, np.int32), votes.ravel()
    for at in range(len(ideal)):
        x, y = ideal[at, 0], ideal[at, 1]
        count = _cells(x, y, normal_rad[at], aside, cell_px, directions, columns, found)
        for cell in found[:count]:
            table[cell] += 1


@njit(cache=True, nogil=True)
def _back(
    ideal: Array, normal_rad: Array, range_rad: float, cell_px: float, votes: Votes, least: int
) -> NDArray[np.int32]:
    rows, columns = votes.shape
    directions, aside = _directions(rows), _aside(range_rad, rows)
    found, table = np.empty(rows, np.int32), votes.ravel()
    backed = np.full(len(ideal), -1, np.int32)
    for at in range(len(ideal)):
        x, y, most = ideal[at, 0], ideal[at, 1], least - 1
        count = _cells(x, y, normal_rad[at], aside, cell_px, directions, columns, found)
        for cell in found[:count]:
            if table[cell] > most:
                most = table[cell]
                backed[at] = cell // columns
    return backed
