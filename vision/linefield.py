"""How well an image supports many poses at once: image lines spread into a field, map segments laid over it.

The field holds, for cells of the image and directions of the full circle (brighter side on the right), how near
the nearest image line of about this direction is: 1 on the line, falling off as a Gaussian. A pose is worth what
its predicted segments find there, seen or not, sampled along them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from vision.camera import BASE_FROM_OPTICAL, rotation_x, rotation_y
from vision.lines import ImageSegments
from vision.projection import Projector, framed_span
from vision.viewpoints import Viewpoints

#: Directions of the full circle.
_BINS = 48
#: Cells of the field along the longer side of the image.
_CELLS = 160
#: Rows of the scoring table.
_HIT, _MISS, _POLARITY = range(3)


@dataclass(frozen=True, slots=True, eq=False)
class LineField:
    """One image's lines, spread out.

    `nearness`: (48, rows, columns) uint8, 255 on a line. `origin_px`: ideal pixel of the first cell's corner,
    `cell_px`: width of a cell. `chance`: (48,) mean nearness of a direction: what an accident finds.
    """

    nearness: NDArray[np.uint8]
    origin_px: tuple[float, float]
    cell_px: float
    chance: Array


@dataclass(frozen=True, slots=True)
class FieldConfig:
    """What seen and unseen stretches are worth in the coarse score."""

    #: Width of the kernel, beside the lines' own uncertainty.
    kernel_px: float = 6.0
    #: Image length that counts as one look, and the most looks at one edge.
    unit_px: float = 30.0
    max_units: float = 5.0
    #: Share of a visible edge that shows in an image, where the map has not learnt it.
    detection_rate: float = 0.4


def line_field(segments: ImageSegments, projector: Projector, kernel_px: float) -> LineField:
    """Spread an image's segments with a kernel of at least this width, pixels.

    It is as much wider as the segments and the camera are uncertain.
    """
    left, right, top, bottom = projector.bounds * projector.camera.focal_px
    cell = max(right - left, bottom - top) / _CELLS
    shape = (_BINS, math.ceil((bottom - top) / cell) + 1, math.ceil((right - left) / cell) + 1)
    nearness = np.zeros(shape, np.uint8)
    _spread(
        nearness,
        (segments.ideal_px - [left, top]) / cell,
        np.sqrt(kernel_px**2 + segments.sigma_px**2 + projector.camera.shift_px**2) / cell,
        segments.polarity < 0.0,
    )
    chance = np.clip(nearness.mean(axis=(1, 2)) / 255.0, 0.01, 0.5)
    return LineField(nearness, (left, top), cell, chance)


def field_scores(
    field: LineField,
    projector: Projector,
    viewpoints: Viewpoints,
    poses: Array,
    views: NDArray[np.int64],
    config: FieldConfig,
) -> Array:
    """Return the support (H,) of poses (H, 3), in nats, by what is seen from each one's viewpoint, `views` (H,)."""
    wire_map = projector.wire_map
    rate = wire_map.detection_rate[viewpoints.rows]
    rate = np.clip(np.where(np.isnan(rate), config.detection_rate, rate), 0.05, 0.95)
    camera, mount = projector.camera, projector.camera.mount
    level_from_optical = rotation_y(mount.pitch_down_rad) @ rotation_x(mount.roll_rad) @ BASE_FROM_OPTICAL
    half = _BINS // 2
    return _scores(
        field.nearness,
        np.maximum(field.nearness[:half], field.nearness[half:]),
        np.array([*field.origin_px, field.cell_px]),
        np.log(field.chance),
        np.log1p(-field.chance),
        projector.bounds,
        camera.focal_px,
        np.array([mount.x_m, mount.y_m, mount.height_m, mount.yaw_rad]),
        level_from_optical,
        viewpoints.pieces,
        viewpoints.starts,
        np.vstack([np.log(rate), np.log1p(-rate), wire_map.polarity[viewpoints.rows]]),
        np.ascontiguousarray(poses),
        views,
        config.unit_px,
        config.max_units,
    )


@njit(cache=True, nogil=True)
def _spread(nearness: NDArray[np.uint8], ends: Array, widths: Array, flip: NDArray[np.bool_]) -> None:
    """Draw each line (M, 2, 2), in cells, into the two directions nearest to its own."""
    bins, rows, columns = nearness.shape
    for m in range(len(ends)):
        x0, y0 = ends[m, 0, 0], ends[m, 0, 1]
        dx, dy = ends[m, 1, 0] - x0, ends[m, 1, 1] - y0
        length = max(math.hypot(dx, dy), 1e-9)
        dx, dy = dx / length, dy / length
        turn = math.atan2(dy, dx) / (2.0 * math.pi) * bins
        if flip[m]:
            turn += 0.5 * bins
        first = math.floor(turn)
        reach = 2.5 * widths[m]
        low_y = max(int(min(y0, y0 + dy * length) - reach), 0)
        high_y = min(int(max(y0, y0 + dy * length) + reach) + 1, rows - 1)
        scale = -0.5 / widths[m] ** 2
        for row in range(low_y, high_y + 1):
            # Where this row of cells runs inside the band about the line.
            py = row + 0.5 - y0
            if abs(dy) > 1e-6:
                middle, half = dx * py / dy, reach / abs(dy)
            else:
                middle, half = 0.5 * dx * length, length + reach
            low_x = max(int(max(x0 + middle - half, min(x0, x0 + dx * length) - reach)), 0)
            high_x = min(int(min(x0 + middle + half, max(x0, x0 + dx * length) + reach)) + 1, columns - 1)
            for column in range(low_x, high_x + 1):
                px = column + 0.5 - x0
                along = dx * px + dy * py
                beyond = max(max(-along, along - length), 0.0)
                across = dx * py - dy * px
                value = np.uint8(255.0 * math.exp(scale * (across * across + beyond * beyond)))
                for side in range(2):
                    at = (first + side) % bins
                    nearness[at, row, column] = max(nearness[at, row, column], value)


@njit(cache=True, nogil=True)
def _scores(
    nearness: NDArray[np.uint8],
    either_way: NDArray[np.uint8],
    grid: Array,
    log_chance: Array,
    log_no_chance: Array,
    bounds: Array,
    focal: float,
    mount: Array,
    level_from_optical: Array,
    pieces: Array,
    starts: NDArray[np.int64],
    worth: Array,
    poses: Array,
    views: NDArray[np.int64],
    unit_px: float,
    max_units: float,
) -> Array:
    bins = nearness.shape[0]
    scores = np.zeros(len(poses))
    ends = np.empty((2, 3))
    # Normals of the planes that bound the view on the left and on the right, inwards, in the level frame.
    sides = np.empty((2, 3))
    sides[0] = level_from_optical[:, 0] - bounds[0] * level_from_optical[:, 2]
    sides[1] = bounds[1] * level_from_optical[:, 2] - level_from_optical[:, 0]
    for h in range(len(poses)):
        x, y, phi = poses[h]
        psi = phi + mount[3]
        cos, sin = math.cos(psi), math.sin(psi)
        centre_x = x + math.cos(phi) * mount[0] - math.sin(phi) * mount[1]
        centre_y = y + math.sin(phi) * mount[0] + math.cos(phi) * mount[1]
        for p in range(starts[views[h]], starts[views[h] + 1]):
            if _beside(pieces[p], centre_x, centre_y, mount[2], cos, sin, sides):
                continue
            _seen(pieces[p], centre_x, centre_y, mount[2], cos, sin, level_from_optical, ends)
            low, high = framed_span(ends, bounds)
            if low >= high:
                continue
            u0, v0 = _projected(ends, low, focal)
            u1, v1 = _projected(ends, high, focal)
            length = math.hypot(u1 - u0, v1 - v0)
            if length < 10.0:
                continue
            turn = math.atan2(v1 - v0, u1 - u0) / (2.0 * math.pi) * bins
            first = math.floor(turn + 0.5) % bins
            second = (first + bins // 2) % bins
            plane = either_way[first % (bins // 2)]
            if worth[_POLARITY, p] > 0.5:
                second, plane = first, nearness[first]
            elif worth[_POLARITY, p] < -0.5:
                first, plane = second, nearness[second]
            looks = max(int(min(length / unit_px, max_units)), 1) + 1
            near = _found(plane, grid, (u0, v0), (u1, v1), looks)
            units = min(length / unit_px, max_units)
            chance = 0.5 * (log_chance[first] + log_chance[second])
            no_chance = 0.5 * (log_no_chance[first] + log_no_chance[second])
            hit = worth[_HIT, p] - chance
            miss = min(worth[_MISS, p] - no_chance, 0.0)
            scores[h] += units * (near * hit + (1.0 - near) * miss)
    return scores


@njit(cache=True, nogil=True)
def _beside(piece: Array, x: float, y: float, z: float, cos: float, sin: float, sides: Array) -> bool:
    """Whether a piece lies beside the view: most do, and need no closer look."""
    for side in range(2):
        ahead, left, up = sides[side, 0], sides[side, 1], sides[side, 2]
        east, north = cos * ahead - sin * left, sin * ahead + cos * left
        if (
            east * (piece[0, 0] - x) + north * (piece[0, 1] - y) + up * (piece[0, 2] - z) <= 0.0
            and east * (piece[1, 0] - x) + north * (piece[1, 1] - y) + up * (piece[1, 2] - z) <= 0.0
        ):
            return True
    return False


@njit(cache=True, nogil=True)
def _seen(
    piece: Array,
    x: float,
    y: float,
    z: float,
    cos: float,
    sin: float,
    level_from_optical: Array,
    ends: Array,
) -> None:
    """Fill in a piece's end points (2, 3) in the optical frame of a camera at x, y, z."""
    for end in range(2):
        east, north, up = piece[end, 0] - x, piece[end, 1] - y, piece[end, 2] - z
        ahead, left = cos * east + sin * north, cos * north - sin * east
        for axis in range(3):
            ends[end, axis] = (
                ahead * level_from_optical[0, axis]
                + left * level_from_optical[1, axis]
                + up * level_from_optical[2, axis]
            )


@njit(cache=True, nogil=True)
def _found(
    plane: NDArray[np.uint8], grid: Array, start: tuple[float, float], end: tuple[float, float], looks: int
) -> float:
    """How near lines of one direction are to a piece, on the mean of so many looks along it: 0 to 1."""
    near = 0.0
    for at in range(looks):
        along = (at + 0.5) / looks
        column = int((start[0] + along * (end[0] - start[0]) - grid[0]) / grid[2])
        row = int((start[1] + along * (end[1] - start[1]) - grid[1]) / grid[2])
        if 0 <= row < plane.shape[0] and 0 <= column < plane.shape[1]:
            near += plane[row, column]
    return near / (255.0 * looks)


@njit(cache=True, nogil=True)
def _projected(ends: Array, along: float, focal: float) -> tuple[float, float]:
    x = ends[0, 0] + along * (ends[1, 0] - ends[0, 0])
    y = ends[0, 1] + along * (ends[1, 1] - ends[0, 1])
    z = ends[0, 2] + along * (ends[1, 2] - ends[0, 2])
    return focal * x / z, focal * y / z
