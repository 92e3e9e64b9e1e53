"""The image's gradient, smoothed by a Gaussian, and the noise in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.images import GreyImage

#: Integer steps per grey level and pixel.
GAIN = 32.0
#: Every so many-th row tells the noise; twice as many, and as many columns, the unrest.
_STRIDE = 8
#: Lower quartiles of a Rayleigh distribution and of the absolute value of a Gaussian one.
_RAYLEIGH_QUARTER = math.sqrt(-2.0 * math.log(0.75))
_GAUSS_QUARTER = 0.3186


@dataclass(frozen=True, slots=True, eq=False)
class Gradient:
    """Derivatives of the smoothed image; `dx`, `dy`: (H, W) int16, `GAIN` per grey level and pixel.

    `noise`: standard deviation of either where the scene is quiet, grey levels per pixel: noise, fine texture.
    """

    dx: NDArray[np.int16]
    dy: NDArray[np.int16]
    noise: float


def gradient_of(image: GreyImage, smoothing_px: float) -> Gradient:
    """Convolve with the derivatives of a Gaussian (Canny 1986) of `smoothing_px` standard deviation."""
    reach = math.ceil(3.0 * smoothing_px)
    taps = np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (taps / smoothing_px) ** 2)
    smooth, slope = bell / bell.sum(), taps * bell
    # A ramp of one grey level per pixel shall give exactly one.
    slope = GAIN * slope / (taps * slope).sum()
    dx = np.asarray(cv2.sepFilter2D(image, cv2.CV_16S, slope, smooth), np.int16)
    dy = np.asarray(cv2.sepFilter2D(image, cv2.CV_16S, smooth, slope), np.int16)
    return Gradient(dx, dy, _unrest(dx, dy, image))


def pixel_noise(image: GreyImage) -> float:
    """Estimate the standard deviation of a pixel's noise, grey levels, where the image does not clip.

    From second differences along both axes (Immerkaer 1996), to which edges and shades give nothing; the
    lower quarter of them, so that texture gives little.
    """
    rows = [image[first::_STRIDE][: (len(image) - 2) // _STRIDE].astype(np.int16) for first in range(3)]
    bent = rows[0] - 2 * rows[1] + rows[2]
    bent = np.abs(bent[:, :-2] - 2 * bent[:, 1:-1] + bent[:, 2:])
    return _lower_quarter(bent[_unclipped(rows[1][:, 1:-1])]) / (_GAUSS_QUARTER * 6.0)


def _unrest(dx: NDArray[np.int16], dy: NDArray[np.int16], image: GreyImage) -> float:
    """The quiet quarter of the magnitudes, taken for the lower quarter of a Rayleigh distribution.

    Where the image is clipped there is nothing to see: those pixels do not count.
    """
    few = slice(None, None, _STRIDE // 2)
    x, y = (of[few, few].astype(np.float32) for of in (dx, dy))
    square = (x * x + y * y)[_unclipped(image[few, few])]
    return math.sqrt(_lower_quarter(square)) / (_RAYLEIGH_QUARTER * GAIN)


def _unclipped(levels: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray((levels > 0) & (levels < 255))


def _lower_quarter(values: NDArray[Any]) -> float:
    rank = len(values) // 4
    return float(np.partition(values, rank)[rank]) if len(values) else 0.0
