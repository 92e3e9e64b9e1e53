"""Straight segments in an image, undistorted, by one of several extractors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, frozen
from vision.camera import Camera
from vision.edgelines import EdgeConfig, find_edges
from vision.houghlines import END_SIGMA_PX, HoughConfig, find_hough
from vision.images import GreyImage
from vision.lsd import brighter_right, find_lsd, straightened

#: Farther than this from where it was measured no line's end may come back from undistortion.
_ASTRAY_PX = 2.0


class LineMethod(StrEnum):
    """How lines are found."""

    #: Chains of edge points, fitted (`vision.edgelines`).
    EDGES = "edges"
    #: OpenCV's line segment detector.
    LSD = "lsd"
    #: The paper's extractor (`vision.houghlines`).
    HOUGH = "hough"


@dataclass(frozen=True, slots=True)
class LineConfig:
    """What counts as a line."""

    method: LineMethod = LineMethod.EDGES
    #: Shorter segments are mostly texture, and constrain little.
    min_length_px: float = 20.0
    #: Standard deviation of an end point across its line, beside what the image's noise explains: real edges
    #: are rounded, unevenly lit and, under distortion, bent.
    sigma_px: float = 0.5
    #: Both EDGES and HOUGH find contours as `edges` says; the rest of it is for EDGES alone.
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    hough: HoughConfig = field(default_factory=HoughConfig)


@dataclass(frozen=True, slots=True, eq=False)
class ImageSegments:
    """M straight segments of one image; arrays are read-only.

    `raw_px`: (M, 2, 2) end points as found, in raw pixels.
    `ideal_px`: (M, 2, 2) the same, undistorted, as pixels of an ideal camera: u right and v down from the
    principal point, focal length `Camera.focal_px` on both axes.
    `sigma_px`: (M,) standard deviation of an end point across the line, for weighing it against a map.
    `sigma_middle_px`, `sigma_angle_rad`: (M,) standard deviations of the middle across the line and of the
    direction, as far as the image tells: the measurement's alone.
    `polarity`: (M,) +1 brighter on the right-hand side looking from the first end to the second, -1 darker.
    `contrast`: (M,) grey levels between the two sides.
    `pivot_px`: (M,) where the errors of offset and direction are independent: pixels from the middle towards the
    second end; 0, the middle, for lines that are measured all along.
    """

    raw_px: Array
    ideal_px: Array
    sigma_px: Array
    sigma_middle_px: Array
    sigma_angle_rad: Array
    polarity: Array
    contrast: Array
    pivot_px: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not len(self.pivot_px):
            object.__setattr__(self, "pivot_px", np.zeros(len(self.raw_px)))
        for column in fields(self):
            object.__setattr__(self, column.name, frozen(getattr(self, column.name)))

    def __len__(self) -> int:
        return len(self.raw_px)

    def __getitem__(self, keep: NDArray[Any]) -> ImageSegments:
        """Return some of the segments, by numbers or a mask."""
        return ImageSegments(*(getattr(self, column.name)[keep] for column in fields(self)))

    @property
    def lengths_px(self) -> Array:
        """Lengths in ideal pixels, (M,)."""
        result: Array = np.linalg.norm(self.ideal_px[:, 1] - self.ideal_px[:, 0], axis=1)
        return result


def extract_segments(image: GreyImage, camera: Camera, config: LineConfig) -> ImageSegments:
    """Extract straight segments of a grey image (H, W), the first end of each to the left of the second."""
    if not image.size:
        return ImageSegments(*np.zeros((2, 0, 2, 2)), *np.zeros((5, 0)))
    find = {LineMethod.EDGES: _by_edges, LineMethod.LSD: _by_lsd, LineMethod.HOUGH: _by_hough}
    return find[config.method](image, camera, config)


def _by_edges(image: GreyImage, camera: Camera, config: LineConfig) -> ImageSegments:
    lines = find_edges(image, camera, config.edges, config.min_length_px)
    length = np.linalg.norm(lines.ideal_px[:, 1] - lines.ideal_px[:, 0], axis=1)
    raw = camera.distort(lines.ideal_px.reshape(-1, 2) / camera.focal_px).reshape(-1, 2, 2)
    keep = np.linalg.norm(raw - lines.raw_px, axis=2).max(axis=1, initial=0.0) <= _ASTRAY_PX
    noise = np.hypot(lines.sigma_middle_px, 0.5 * length * lines.sigma_angle_rad)
    swap = raw[:, 0, 0] > raw[:, 1, 0]
    return ImageSegments(
        raw_px=_swapped(raw, swap),
        ideal_px=_swapped(lines.ideal_px, swap),
        sigma_px=np.hypot(config.sigma_px, noise),
        sigma_middle_px=lines.sigma_middle_px,
        sigma_angle_rad=lines.sigma_angle_rad,
        polarity=np.where(swap, -1.0, 1.0),
        contrast=lines.contrast,
    )[keep]


def _by_lsd(image: GreyImage, camera: Camera, config: LineConfig) -> ImageSegments:
    raw = find_lsd(image)
    raw = _swapped(raw, raw[:, 0, 0] > raw[:, 1, 0])
    raw = raw[np.linalg.norm(raw[:, 1] - raw[:, 0], axis=1) >= config.min_length_px]
    ideal = straightened(raw, camera)
    sane = np.isfinite(ideal).all(axis=(1, 2))
    raw, ideal = raw[sane], ideal[sane]
    step = brighter_right(image, raw)
    sigma = np.full(len(raw), config.sigma_px)
    length = np.maximum(np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1), 1e-9)
    return ImageSegments(
        raw_px=raw,
        ideal_px=ideal,
        sigma_px=sigma,
        # Two ends that err independently.
        sigma_middle_px=sigma / math.sqrt(2.0),
        sigma_angle_rad=sigma * math.sqrt(2.0) / length,
        polarity=np.sign(step),
        contrast=np.abs(step),
    )


def _by_hough(image: GreyImage, camera: Camera, config: LineConfig) -> ImageSegments:
    lines = find_hough(image, camera, config.hough, config.edges)
    length = np.linalg.norm(lines.ideal_px[:, 1] - lines.ideal_px[:, 0], axis=1)
    swap = lines.raw_px[:, 0, 0] > lines.raw_px[:, 1, 0]
    raw = _swapped(lines.raw_px, swap)
    ends = np.full(len(raw), END_SIGMA_PX)
    return ImageSegments(
        raw_px=raw,
        ideal_px=_swapped(lines.ideal_px, swap),
        sigma_px=np.hypot(config.sigma_px, ends),
        # Two ends that err independently.
        sigma_middle_px=ends / math.sqrt(2.0),
        sigma_angle_rad=ends * math.sqrt(2.0) / length,
        polarity=np.where(swap, -1.0, 1.0),
        contrast=np.abs(brighter_right(image, raw)),
    )[length >= config.min_length_px]


def _swapped(ends: Array, swap: NDArray[np.bool_]) -> Array:
    """The segments (M, 2, 2) with the ends of some of them exchanged."""
    result: Array = np.where(swap[:, None, None], ends[:, ::-1], ends)
    return result
