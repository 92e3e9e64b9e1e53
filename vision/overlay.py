"""Segments, and what was matched, drawn over their image."""

from __future__ import annotations

import cv2
import numpy as np

from maps.outcomes import Look
from maps.poses import Array
from vision.images import GreyImage
from vision.lines import ImageSegments

#: Blue, green, red: brighter on the right, brighter on the left, cannot be told.
_COLOURS = {1.0: (60, 160, 255), -1.0: (255, 160, 40), 0.0: (0, 220, 0)}
#: Blue, green, red: lines that nothing claims, predicted edges not found, and matched ones by their residual.
_LOOSE, _PREDICTED, _CLOSE, _OFF = (150, 150, 150), (255, 190, 90), (70, 200, 60), (40, 60, 240)
#: The residual, in pixels, at which a match is drawn as far off.
_OFF_PX = 3.0
#: Fractions of a pixel that OpenCV draws, as a power of two.
_SHIFT = 4


def overlay_png(image: GreyImage, segments: ImageSegments) -> bytes:
    """Return a PNG of the image (H, W) with its segments, coloured by which side is brighter."""
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for ends, polarity in zip(segments.raw_px, segments.polarity.tolist(), strict=True):
        _line(canvas, ends, _COLOURS[polarity], 1)
    return bytes(cv2.imencode(".png", canvas)[1])


def matched_png(image: GreyImage, look: Look) -> bytes:
    """Return a PNG of the image (H, W) with what a look paired in it.

    Matched lines green to red by their residual, predicted edges that were not found in pale blue, dashed, and lines
    that no edge claims in grey.
    """
    return bytes(cv2.imencode(".png", _matched(image, look))[1])


def matched_jpeg(image: GreyImage, look: Look, quality: int = 70) -> bytes:
    """Return the same as a JPEG, a tenth as large: for pages with several."""
    return bytes(cv2.imencode(".jpg", _matched(image, look), [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def _matched(image: GreyImage, look: Look) -> cv2.typing.MatLike:
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    loose = np.setdiff1d(np.arange(len(look.lines_px)), look.matched_image)
    for ends in look.lines_px[loose]:
        _line(canvas, ends, _LOOSE, 1)
    for ends in look.predicted_px[~np.isin(look.predicted_map, look.matched_map)]:
        _dashed(canvas, ends, _PREDICTED)
    for line, residual in zip(look.matched_image, look.residuals_px, strict=True):
        off = min(residual / _OFF_PX, 1.0)
        colour = tuple(int((1.0 - off) * a + off * b) for a, b in zip(_CLOSE, _OFF, strict=True))
        _line(canvas, look.lines_px[line], colour, 2)
    return canvas


def _line(canvas: cv2.typing.MatLike, ends: Array, colour: tuple[int, ...], width: int) -> None:
    first, second = np.rint(ends * 2**_SHIFT).astype(int).tolist()
    cv2.line(canvas, first, second, colour, width, cv2.LINE_AA, _SHIFT)


def _dashed(canvas: cv2.typing.MatLike, ends: Array, colour: tuple[int, ...]) -> None:
    dashes = max(int(np.linalg.norm(ends[1] - ends[0]) / 8.0), 1)
    for at in range(0, dashes, 2):
        share = np.array([[at], [at + 1]]) / dashes
        _line(canvas, ends[0] + share * (ends[1] - ends[0]), colour, 1)
