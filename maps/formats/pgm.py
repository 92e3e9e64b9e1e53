"""PGM pictures, the grey images of occupancy grids: text (P2) or bytes (P5)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maps.documents import MAX_BYTES
from maps.errors import InputError

#: 8192 x 8192: a square of 400 m at 5 cm.
MAX_PIXELS = 2**26
_HEADER = re.compile(rb"(P[25])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d{1,9})" + rb"(?:\s|#[^\n]*\n)", re.DOTALL)


def read_pgm(path: Path) -> NDArray[np.float64]:
    """Return a picture's grey levels (rows, columns) from 0, black, to 1, white; row 0 is the top.

    InputError where the file is none, is cut short or is larger than MAX_PIXELS.
    """
    try:
        if path.stat().st_size > 2 * MAX_BYTES:
            raise InputError(path, "", f"larger than {2 * MAX_BYTES // 2**20} MB")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from None
    header = _HEADER.match(content)
    if header is None:
        raise InputError(path, "", "not a PGM picture (P2 or P5)")
    columns, rows, white = (int(number) for number in header.groups()[1:])
    if not (0 < columns * rows <= MAX_PIXELS and 0 < white < 2**16):
        raise InputError(path, "", f"{columns} x {rows} pixels up to {white}: out of range")
    body = content[header.end() :]
    if header[1] == b"P5":
        grey = np.frombuffer(body[: columns * rows * (1 + (white > 255))], np.uint8 if white < 256 else ">u2")
    else:
        try:
            grey = np.array(body.split()[: columns * rows], np.int64)
        except (ValueError, OverflowError):
            raise InputError(path, "", "a pixel is not a number") from None
    if len(grey) < columns * rows:
        raise InputError(path, "", f"ends after {len(grey)} of {columns * rows} pixels")
    if grey.min() < 0 or grey.max() > white:
        raise InputError(path, "", f"a pixel is not in 0 to {white}")
    return grey.reshape(rows, columns) / white


def pgm_bytes(grey: NDArray[np.uint8]) -> bytes:
    """Return a picture of grey levels (rows, columns), row 0 at the top, as a PGM file's contents."""
    rows, columns = grey.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + grey.tobytes()
