"""Images as cameras send them, rows of raw pixels, made into image files without loss."""

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
    "bgr8": (3, np.uint8, None),
    "8UC3": (3, np.uint8, None),
    "rgb8": (3, np.uint8, cv2.COLOR_RGB2BGR),
    "bgra8": (4, np.uint8, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, np.uint8, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, np.uint8, cv2.COLOR_RGBA2BGR),
    # OpenCV counts the pattern from the second row and column.
    "bayer_rggb8": (1, np.uint8, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (1, np.uint8, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (1, np.uint8, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (1, np.uint8, cv2.COLOR_BayerGB2BGR),
    "yuv422": (2, np.uint8, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, np.uint8, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, np.uint8, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, np.uint8, cv2.COLOR_YUV2BGR_YUY2),
}

#: Fast: what is written here is mostly read again at once.
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


def png(image: NDArray[np.integer[Any]]) -> bytes:
    """Return a grey image (H, W) or one of blue, green and red (H, W, 3) as a PNG file's bytes."""
    done, data = cv2.imencode(".png", image, _PNG)
    if not done:
        raise ValueError(f"no PNG of an image of shape {image.shape}")
    return data.tobytes()


def raw_png(raw: RawImage) -> bytes:
    """Return raw pixels as a PNG file's bytes; ValueError where they are not what they are said to be."""
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
        return png(image[:, :, 0] if channels == 1 else image)
    try:
        return png(np.asarray(cv2.cvtColor(image, conversion), np.uint8))
    except cv2.error:
        raise ValueError(f"an image of {raw.width} x {raw.height} px is no {raw.encoding}") from None
