"""Images as cameras send them, rows of raw pixels, made into files of their grey levels.

Colours become their luminance here already: files with colours are turned grey by each decoder in its own way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.images import MAX_PIXELS

#: How a camera's encoding (ROS's names) becomes what OpenCV writes: channels, depth, conversion.
_ENCODINGS: dict[str, tuple[int, type[np.uint8] | type[np.uint16], int | None]] = {
    "mono8": (1, np.uint8, None),
    "8UC1": (1, np.uint8, None),
    "mono16": (1, np.uint16, None),
    "16UC1": (1, np.uint16, None),
    "bgr8": (3, np.uint8, cv2.COLOR_BGR2GRAY),
    "8UC3": (3, np.uint8, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, np.uint8, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, np.uint8, cv2.COLOR_BGRA2GRAY),
    "8UC4": (4, np.uint8, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, np.uint8, cv2.COLOR_RGBA2GRAY),
    # OpenCV counts the pattern from the second row and column.
    "bayer_rggb8": (1, np.uint8, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, np.uint8, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, np.uint8, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, np.uint8, cv2.COLOR_BayerGB2GRAY),
    "yuv422": (2, np.uint8, cv2.COLOR_YUV2GRAY_UYVY),
    "uyvy": (2, np.uint8, cv2.COLOR_YUV2GRAY_UYVY),
    "yuv422_yuy2": (2, np.uint8, cv2.COLOR_YUV2GRAY_YUY2),
    "yuyv": (2, np.uint8, cv2.COLOR_YUV2GRAY_YUY2),
}

#: Fast, and hardly larger than at its best.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


@dataclass(frozen=True, slots=True, eq=False)
class RawImage:
    """Pixels of an image (height, width), each row `row_bytes` long; `encoding` as ROS calls it."""

    encoding: str
    width: int
    height: int
    row_bytes: int
    big_endian: bool
    data: NDArray[np.uint8]


def plain_file(image: NDArray[np.integer[Any]]) -> bytes:
    """Return an image (H, W), or one of blue, green and red (H, W, 3), as a PGM file's bytes: 8 or 16 bits of grey.

    It holds the pixels as they are: made and read again in no time.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return cv2.imencode(".pgm", grey)[1].tobytes()


def kept_file(content: bytes) -> bytes:
    """Return an image file's bytes as they are to be kept: pixels as they are become a PNG, without loss."""
    if not content.startswith(b"P5"):
        return content
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        return content
    return cv2.imencode(".png", image, _PNG)[1].tobytes()


def raw_file(raw: RawImage) -> bytes:
    """Return raw pixels as a PGM file's bytes; ValueError where they are not what they are said to be."""
    if raw.encoding not in _ENCODINGS:
        raise ValueError(f"images are {raw.encoding!r}, none of {', '.join(_ENCODINGS)}")
    channels, depth, conversion = _ENCODINGS[raw.encoding]
    used = raw.width * channels * np.dtype(depth).itemsize
    if not 0 < raw.width * raw.height <= MAX_PIXELS:
        raise ValueError(f"an image of {raw.width} x {raw.height} px")
    if raw.row_bytes < used or len(raw.data) < raw.row_bytes * raw.height:
        raise ValueError(
            f"{len(raw.data)} bytes are too few for {raw.width} x {raw.height} px of {raw.encoding}"
        )
    rows = raw.data[: raw.row_bytes * raw.height].reshape(raw.height, raw.row_bytes)[:, :used]
    pixels = np.ascontiguousarray(rows).view(np.dtype(depth).newbyteorder(">" if raw.big_endian else "<"))
    image: NDArray[Any] = np.asarray(pixels, depth).reshape(raw.height, raw.width, channels)
    if conversion is None:
        return plain_file(image[:, :, 0])
    return plain_file(np.asarray(cv2.cvtColor(image, conversion), np.uint8))
