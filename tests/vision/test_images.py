"""Image files, good and bad."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from maps.errors import InputError
from vision.images import MAX_BYTES, MAX_PIXELS, read_image

RAMP = np.tile(np.arange(64, dtype=np.uint8), (48, 1))


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_image(path)
    assert caught.value.path == str(path)
    return caught.value.what


def test_grey_and_colour_images_become_grey_bytes(tmp_path: Path) -> None:
    for name, content in (("grey.png", RAMP), ("colour.png", np.dstack([RAMP] * 3))):
        assert cv2.imwrite(str(tmp_path / name), content)
        image = read_image(tmp_path / name)
        assert image.dtype == np.uint8
        np.testing.assert_array_equal(image, RAMP)


def test_sixteen_bits_are_scaled_to_eight(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "deep.png"), RAMP.astype(np.uint16) * 257)
    np.testing.assert_array_equal(read_image(tmp_path / "deep.png"), RAMP)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert refused(tmp_path / "none.png") == "no such file"
    assert refused(tmp_path)


@pytest.mark.parametrize("content", [b"", b"words, no picture", b"\x89PNG\r\n\x1a\n", bytes(1000)])
def test_what_is_not_an_image(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "frame.png"
    path.write_bytes(content)
    assert refused(path) == "not an image that can be read"


def test_a_truncated_header_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), RAMP)
    path.write_bytes(path.read_bytes()[:30])
    assert refused(path) == "not an image that can be read"


@pytest.mark.parametrize("left", [0.02, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".webp", ".pgm"])
def test_a_truncated_picture_is_not_passed_off_as_whole(
    tmp_path: Path, suffix: str, left: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"frame{suffix}"
    noise = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)
    assert cv2.imwrite(str(path), noise)
    path.write_bytes(path.read_bytes()[: int(left * path.stat().st_size)])
    assert refused(path) == "not an image that can be read"
    assert capfd.readouterr().err == "", "the decoders' own words are not for the user"


@pytest.mark.parametrize("name", ["frame.jpg", "frame.png", "frame.pgm", "frame"])
def test_the_name_makes_no_image(tmp_path: Path, name: str) -> None:
    for content in (b"", b"timestamp_s,filename\n0.0,a.jpg\n" * 20, b"P5\n640 480\n255\nab"):
        (tmp_path / name).write_bytes(content)
        assert refused(tmp_path / name) == "not an image that can be read"


def test_the_terminal_is_given_back(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "frame.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    refused(tmp_path / "frame.png")
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"


def test_too_large_a_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "frame.png"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert "larger than" in refused(path)


@pytest.mark.parametrize("bits", [10, 12])
def test_values_of_ten_and_twelve_bits_in_sixteen_keep_their_contrast(tmp_path: Path, bits: int) -> None:
    deep = np.tile(np.arange(256, dtype=np.uint16) << (bits - 8), (48, 1))
    assert cv2.imwrite(str(tmp_path / "deep.png"), deep)
    np.testing.assert_array_equal(read_image(tmp_path / "deep.png")[0], np.arange(256))


@pytest.mark.parametrize("deep", [False, True])
def test_opacity_changes_nothing(tmp_path: Path, deep: bool) -> None:
    opacity = np.random.default_rng(0).integers(0, 256, RAMP.shape, dtype=np.uint8)
    content = np.dstack([RAMP, RAMP, RAMP, opacity])
    written = content.astype(np.uint16) * 257 if deep else content
    assert cv2.imwrite(str(tmp_path / "clear.png"), written)
    np.testing.assert_array_equal(read_image(tmp_path / "clear.png"), RAMP)


def test_floating_point_images_are_refused(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "light.pfm"), RAMP.astype(np.float32))
    assert refused(tmp_path / "light.pfm") == "neither 8 nor 16 bits a pixel"


def test_an_image_too_large_for_any_camera_is_refused(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((2**11, MAX_PIXELS // 2**11 + 1), np.uint8))
    assert "megapixels" in refused(tmp_path / "wide.png")


def test_one_pixel(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "dot.png"), np.full((1, 1), 7, np.uint8))
    np.testing.assert_array_equal(read_image(tmp_path / "dot.png"), [[7]])
