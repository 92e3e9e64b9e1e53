"""Segments drawn over their image."""

from __future__ import annotations

import cv2
import numpy as np

from vision.images import GreyImage
from vision.lines import ImageSegments

#: Blue, green, red: brighter on the right, brighter on the left, cannot be told.
_COLOURS = {1.0: (60, 160, 255), -1.0: (255, 160, 40), 0.0: (0, 220, 0)}
#: Fractions of a pixel that OpenCV draws, as a power of two.
_SHIFT = 4


def overlay_png(image: GreyImage, segments: ImageSegments) -> bytes:
    """Return a PNG of the image (H, W) with its segments, coloured by which side is brighter."""
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for ends, polarity in zip(segments.raw_px, segments.polarity.tolist(), strict=True):
        first, second = np.rint(ends * 2**_SHIFT).astype(int).tolist()
        cv2.line(canvas, first, second, _COLOURS[polarity], 1, cv2.LINE_AA, _SHIFT)
    return bytes(cv2.imencode(".png", canvas)[1])
