"""`wireloc lines`: tables and pictures of lines, and what it says of input that is none."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import Command

HEADER = ["image", "x1", "y1", "x2", "y2", "sigma_px", "polarity", "contrast"]


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """Return a picture with a bright square from 39.5 to 119.5."""
    image = np.full((160, 200), 50, np.uint8)
    image[40:120, 40:120] = 200
    path = tmp_path / "square.png"
    cv2.imwrite(str(path), cv2.GaussianBlur(image, (0, 0), 0.7))
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_squares_sides_are_listed_in_raw_pixels(wireloc: Command, picture: Path, tmp_path: Path) -> None:
    out, overlay = tmp_path / "lines.csv", tmp_path / "lines.png"
    ended = wireloc("lines", picture, "--out", out, "--overlay", overlay)
    assert ended.code == 0, ended.err
    assert out.read_text().splitlines()[0].split(",") == HEADER
    rows = rows_of(out)
    assert len(rows) == 4
    upright = sorted(float(row["x1"]) for row in rows if abs(float(row["x1"]) - float(row["x2"])) < 2.0)
    np.testing.assert_allclose(upright, [39.5, 119.5], atol=0.05)
    assert {row["polarity"] for row in rows} <= {"+1", "-1"}
    assert all(abs(float(row["contrast"]) - 150.0) < 8.0 for row in rows)
    drawn = cv2.imread(str(overlay))
    assert drawn.shape == (160, 200, 3)
    assert (drawn[..., 0] != drawn[..., 2]).sum() > 200


@pytest.mark.parametrize("method", ["edges", "lsd", "hough"])
def test_deep_and_coloured_images_serve_and_even_ones_have_no_lines(
    wireloc: Command, picture: Path, tmp_path: Path, method: str
) -> None:
    image = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
    shapes = {
        "deep.png": image.astype(np.uint16) * 257,
        "colour.png": cv2.cvtColor(image, cv2.COLOR_GRAY2BGR),
        "alpha.png": cv2.cvtColor(image, cv2.COLOR_GRAY2BGRA),
        "even.png": np.full((60, 80), 128, np.uint8),
        "white.png": np.full((60, 80), 255, np.uint8),
        "point.png": np.full((1, 1), 7, np.uint8),
    }
    for name, content in shapes.items():
        cv2.imwrite(str(tmp_path / name), content)
    config, out = tmp_path / "lines.yaml", tmp_path / "lines.csv"
    config.write_text(f"matcher: {{lines: {{method: {method}}}}}\n")
    ended = wireloc("lines", *(tmp_path / name for name in shapes), "--config", config, "--out", out)
    assert ended.code == 0, ended.err
    found = [Path(row["image"]).name for row in rows_of(out)]
    assert {name: found.count(name) for name in shapes} == {
        "deep.png": 4, "colour.png": 4, "alpha.png": 4, "even.png": 0, "white.png": 0, "point.png": 0,
    }  # fmt: skip


def test_the_camera_must_fit_the_image(wireloc: Command, sample: Path, picture: Path, tmp_path: Path) -> None:
    out = tmp_path / "lines.csv"
    ended = wireloc("lines", picture, "--camera", sample / "robot.yaml", "--out", out)
    assert (ended.code, out.exists()) == (2, False)
    assert "square.png" in ended.err
    assert "200x160" in ended.err
    frame = next(iter(sorted((sample / "images").iterdir())))
    assert wireloc("lines", frame, "--camera", sample / "robot.yaml", "--out", out).code == 0
    assert len(rows_of(out)) > 20


def broken(name: str) -> bytes:
    """Return the contents of a picture file that is none."""
    noise = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)
    whole = bytes(cv2.imencode(Path(name).suffix, noise)[1])
    contents = {"empty": b"", "text": b"no image", "start": whole[:8], "half": whole[: len(whole) // 2]}
    return contents[Path(name).stem]


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kind", ["empty", "text", "start", "half"])
def test_what_is_no_image_is_told_in_one_line(
    wireloc: Command, picture: Path, kind: str, suffix: str, tmp_path: Path
) -> None:
    bad = tmp_path / f"{kind}{suffix}"
    bad.write_bytes(broken(bad.name))
    ended = wireloc("lines", picture, bad, "--out", tmp_path / "lines.csv")
    assert ended.code == 2
    assert bad.name in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not (tmp_path / "lines.csv").exists()


def test_one_overlay_shows_one_image(wireloc: Command, picture: Path, tmp_path: Path) -> None:
    ended = wireloc("lines", picture, picture, "--out", tmp_path / "a.csv", "--overlay", tmp_path / "a.png")
    assert ended.code == 2
    assert "--overlay" in ended.err


def test_an_unfit_parameter_is_told_in_one_line(wireloc: Command, picture: Path, tmp_path: Path) -> None:
    config = tmp_path / "lines.yaml"
    for content, key in (("{method: houff}", "method"), ("{method: hough, hough: {cell_px: 0}}", "cell_px")):
        config.write_text(f"matcher: {{lines: {content}}}\n")
        ended = wireloc("lines", picture, "--config", config, "--out", tmp_path / "lines.csv")
        assert ended.code == 2
        assert "lines.yaml" in ended.err
        assert key in ended.err
        assert len(ended.err.splitlines()) == 1
