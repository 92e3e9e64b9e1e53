"""Raw pixels as cameras send them, made into files and read back."""

from pathlib import Path

import numpy as np
import pytest

from vision.images import decode_image
from vision.rawimages import RawImage, kept_file, raw_file

RNG = np.random.default_rng(5)
GREY = RNG.integers(0, 255, (6, 8), np.uint8)
#: Flat colours, so that what demosaicing makes of the neighbours is known.
RED, BLUE = (200, 40, 10), (10, 40, 200)


def read(raw):
    """Return the grey levels, the same whether the file is kept or not."""
    content = raw_file(raw)
    image = decode_image(content, Path("message"))
    assert kept_file(content).startswith(b"\x89PNG")
    assert (decode_image(kept_file(content), Path("kept")) == image).all()
    return image


def raw(encoding, rows, width, height=6, big_endian=False):
    data = np.ascontiguousarray(rows)
    return RawImage(
        encoding, width, height, data[0].nbytes, big_endian, np.frombuffer(data.tobytes(), np.uint8)
    )


def test_grey_is_kept():
    assert (read(raw("mono8", GREY, 8)) == GREY).all()


def test_rows_may_be_padded():
    padded = np.hstack([GREY, np.full((6, 4), 77, np.uint8)])
    assert (read(raw("mono8", padded, 8)) == GREY).all()


@pytest.mark.parametrize("big_endian", [False, True])
def test_deep_images_keep_their_upper_bits(big_endian):
    deep = (GREY.astype(np.uint16) << 4) | 0x800
    order = ">u2" if big_endian else "<u2"
    assert (read(raw("mono16", deep.astype(order), 8, big_endian=big_endian)) == deep >> 4).all()


def luminance(colour):
    return 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("rgb8", "rgb"), ("bgr8", "bgr"), ("rgba8", "rgba"), ("bgra8", "bgra"), ("8UC3", "bgr")],
)
@pytest.mark.parametrize("colour", [RED, BLUE])
def test_colours_become_their_luminance(encoding, order, colour):
    parts = dict(zip("rgba", (*colour, 255), strict=True))
    pixels = np.tile(np.array([parts[name] for name in order], np.uint8), (6, 8, 1))
    assert np.abs(read(raw(encoding, pixels, 8)) - luminance(colour)).max() <= 1.0


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("colour", [RED, BLUE])
def test_mosaics(pattern, colour):
    parts = dict(zip("rgb", colour, strict=True))
    tile = np.array([parts[name] for name in pattern], np.uint8).reshape(2, 2)
    image = read(raw(f"bayer_{pattern}8", np.tile(tile, (3, 4)), 8))
    assert np.abs(image[2:-2, 2:-2] - luminance(colour)).max() <= 2.0


@pytest.mark.parametrize(("encoding", "first"), [("uyvy", 1), ("yuv422", 1), ("yuyv", 0), ("yuv422_yuy2", 0)])
def test_brightness_beside_colour_differences(encoding, first):
    pixels = np.full((6, 8, 2), 128, np.uint8)
    pixels[:, :, first] = GREY
    assert (read(raw(encoding, pixels, 8)) == GREY).all()


def test_what_cannot_be():
    with pytest.raises(ValueError, match="none of mono8"):
        raw_file(raw("32FC1", GREY, 2))
    with pytest.raises(ValueError, match="too few"):
        raw_file(raw("rgb8", GREY, 8))
    with pytest.raises(ValueError, match="0 x 6 px"):
        raw_file(raw("mono8", GREY, 0))
