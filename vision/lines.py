"""Straight segments in an image: extraction with OpenCV's LSD, undistorted end points."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from maps.poses import Array, frozen
from vision.camera import Camera
from vision.images import GreyImage

#: OpenCV's LSD works at 0.8 of the size and scales back without moving the pixels' centres, which puts all
#: it finds this much too far left and up.
_SHIFT_PX = 0.125


@dataclass(frozen=True, slots=True)
class LineConfig:
    """What counts as a line."""

    #: Shorter segments are mostly texture, and constrain little.
    min_length_px: float = 20.0
    #: Standard deviation of an end point across its line: LSD reaches 0.12 px on clean drawn edges; real
    #: ones are blurred, unevenly lit and, under distortion, bent.
    sigma_px: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ImageSegments:
    """M straight segments of one image; arrays are read-only.

    `raw_px`: (M, 2, 2) end points as found, in raw pixels.
    `ideal_px`: (M, 2, 2) the same, undistorted, as pixels of an ideal camera: u right and v down from the
    principal point, focal length `Camera.focal_px` on both axes.
    `sigma_px`: (M,) standard deviation of an end point across the line.
    """

    raw_px: Array
    ideal_px: Array
    sigma_px: Array

    def __len__(self) -> int:
        return len(self.raw_px)

    @property
    def lengths_px(self) -> Array:
        """Lengths in ideal pixels, (M,)."""
        result: Array = np.linalg.norm(self.ideal_px[:, 1] - self.ideal_px[:, 0], axis=1)
        return result


def extract_segments(image: GreyImage, camera: Camera, config: LineConfig) -> ImageSegments:
    """Extract straight segments (von Gioi et al. 2010, OpenCV's LSD) and undistort their end points."""
    found = cv2.createLineSegmentDetector().detect(image)[0]
    raw = np.zeros((0, 2, 2)) if found is None else np.asarray(found, np.float64).reshape(-1, 2, 2)
    raw = raw + _SHIFT_PX
    raw = raw[np.linalg.norm(raw[:, 1] - raw[:, 0], axis=1) >= config.min_length_px]
    ideal = _straightened(raw, camera)
    sane = np.isfinite(ideal).all(axis=(1, 2))
    raw, ideal = raw[sane], ideal[sane]
    return ImageSegments(frozen(raw), frozen(ideal), frozen(np.full(len(raw), config.sigma_px)))


def _straightened(raw: Array, camera: Camera) -> Array:
    """Undistort segments (M, 2, 2) that were laid through edges bowed by the lens, into ideal pixels.

    The line that fits a shallow arc best crosses it at 1 / sqrt(12) of its length either side of the middle:
    there the edge is, and not at the line's ends.
    """
    middle, half = raw.mean(axis=1, keepdims=True), 0.5 * (raw[:, 1:] - raw[:, :1])
    crossings = middle + half * np.array([[-1.0], [1.0]]) / np.sqrt(3.0)
    points = camera.undistort(np.concatenate([raw, crossings], axis=1).reshape(-1, 2)).reshape(-1, 4, 2)
    ends, crossings = points[:, :2] * camera.focal_px, points[:, 2:] * camera.focal_px
    along = crossings[:, 1:] - crossings[:, :1]
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    result: Array = crossings[:, :1] + ((ends - crossings[:, :1]) * along).sum(axis=2, keepdims=True) * along
    return result
