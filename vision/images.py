"""Reading images as the line extraction wants them: grey, eight bits."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from maps.errors import InputError

GreyImage = NDArray[np.uint8]

MAX_BYTES = 256 * 2**20


def read_image(path: Path) -> GreyImage:
    """Read an image file as grey levels (H, W); InputError where it is missing or not an image."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, "", f"larger than {MAX_BYTES // 2**20} MB")
        data = np.fromfile(path, np.uint8)
    except FileNotFoundError:
        raise InputError(path, "", "no such file") from None
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(path, "", "not an image that can be read")
    return np.asarray(image, np.uint8)
