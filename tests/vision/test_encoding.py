"""Images for recordings: small, and the same where they are small already."""

import cv2
import numpy as np
import pytest

from vision.encoding import LeanImages


@pytest.fixture
def photo(tmp_path):
    """Return a file of a noisy colour image, too large for what follows."""
    noise = np.random.default_rng(1).normal(128.0, 40.0, (120, 160, 3))
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), np.clip(cv2.GaussianBlur(noise, (0, 0), 1.5) * 1.0, 0, 255).astype(np.uint8))
    return path


def test_small_jpeg_stays_as_it_is(tmp_path, photo):
    path = tmp_path / "small.jpg"
    cv2.imwrite(str(path), cv2.imread(str(photo)))
    data = path.read_bytes()
    assert LeanImages(len(data)).read(path) == data


def test_large_image_becomes_a_small_jpeg_of_its_size_and_colours(photo):
    images = LeanImages(3_000)
    for _ in range(3):
        jpeg = images.read(photo)
        assert len(jpeg) <= 3_000
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (120, 160, 3)
    assert np.abs(image.astype(float) - cv2.imread(str(photo))).mean() < 15.0


def test_quality_comes_back_when_images_become_easier(tmp_path, photo):
    images = LeanImages(3_000)
    images.read(photo)
    easy = tmp_path / "easy.png"
    ramp = np.tile(np.linspace(0.0, 255.0, 160), (120, 1)).astype(np.uint8)
    cv2.imwrite(str(easy), ramp)
    sizes = [len(images.read(easy)) for _ in range(6)]
    assert sizes[-1] > sizes[0]


def test_what_is_no_image_is_none(tmp_path):
    path = tmp_path / "no.jpg"
    path.write_bytes(b"not an image")
    assert LeanImages(1_000).read(path) is None
    path.write_bytes(b"")
    assert LeanImages(1_000).read(path) is None
