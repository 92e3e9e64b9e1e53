"""Reading images as the line extraction wants them: grey, eight bits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from maps.errors import InputError

GreyImage = NDArray[np.uint8]

MAX_BYTES = 256 * 2**20
#: No camera makes larger images; a small file can hold one that fills the memory.
MAX_PIXELS = 2**27

#: Sensors of 10 and 12 bits write their values into 16.
_DEPTHS = (10, 12, 16)

#: One at a time may redirect the process' standard error.
_MUTING = Lock()


def read_image(path: Path) -> GreyImage:
    """Read an image file as grey levels (H, W); InputError where it is missing or not an image.

    Colour becomes its luminance, whatever its opacity; deeper images keep the upper eight of the bits that
    their values use, of 10, 12 or 16.
    """
    return decode_image(read_bytes(path), path)


def read_bytes(path: Path) -> bytes:
    """Return an image file as it is; InputError where it is missing or larger than any image."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, "", f"larger than {MAX_BYTES // 2**20} MB")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "", "no such file") from None
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from None


def decode_image(content: bytes, path: Path) -> GreyImage:
    """Return an image file's bytes as `read_image` would; `path` is named where they are not an image."""
    data = np.frombuffer(content, np.uint8)
    try:
        with muted():
            image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(path, "", "not an image that can be read")
    if image.size > MAX_PIXELS:
        raise InputError(path, "", f"more than {MAX_PIXELS // 10**6} megapixels")
    if image.dtype == np.uint16:
        brightest = int(image.max())
        bits = next(depth for depth in _DEPTHS if brightest < 2**depth)
        image = np.right_shift(image, bits - 8)
    elif image.dtype != np.uint8:
        raise InputError(path, "", "neither 8 nor 16 bits a pixel")
    return np.asarray(image, np.uint8)


@contextmanager
def muted() -> Iterator[None]:
    """Keep the decoders quiet: some write what they find wrong to the terminal, past Python and OpenCV's log."""
    with _MUTING:
        try:
            before = os.dup(2)
        except OSError:
            # There is no standard error to write to.
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)
            os.close(nowhere)
