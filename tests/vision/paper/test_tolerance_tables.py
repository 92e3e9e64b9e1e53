"""Tolerances by Monte Carlo: like the propagated ones where those hold, and kept from run to run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paperviews import CAMERA, MOUNT, views

import vision.paper.tablecache
from maps.poses import Array, wrap_angle
from vision.camera import Camera
from vision.constraints import segment_lines
from vision.lines import ImageSegments
from vision.paper.errors import line_errors
from vision.paper.tablecache import cached_table
from vision.paper.tables import TableConfig, ToleranceTable, build_table, slopes_of
from vision.paper.unary import Geometry, heading_zones

SMALL = TableConfig(angles=12, distances=9, bearings=9, samples=20)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "wireloc"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[Camera]:
    """The cameras whose tables were made, in order."""
    made: list[Camera] = []

    def counted(camera: Camera, slopes: Array, half_view_rad: float, config: TableConfig) -> ToleranceTable:
        made.append(camera)
        return build_table(camera, slopes, half_view_rad, config)

    monkeypatch.setattr(vision.paper.tablecache, "build_table", counted)
    return made


@pytest.mark.parametrize("slope", ["level", "sloped"])
def test_tables_agree_with_propagation(slope: str) -> None:
    seen = views(np.random.default_rng(70), 2000, slope)
    errors = line_errors(CAMERA, one_degree(seen.segments))
    direction, _ = segment_lines(seen.wire_map, seen.rows)
    zones = heading_zones(errors.normals, errors.covariances, direction, np.zeros(2000), seen.disc, 1.0)
    table = build_table(CAMERA, slopes_of(direction, math.radians(5.0)), 0.4, TableConfig(samples=80))
    heading, _ = table.spreads(errors.normals, direction)
    propagated = 0.5 * (zones.high - zones.low)
    # Roots in the window, and not so near the horizon that a spread says little.
    fine = (zones.geometry == Geometry.REGULAR)[:, None] & (propagated < math.radians(3.0))
    fine &= np.abs(wrap_angle(zones.roots - seen.disc.psi)) <= seen.disc.dpsi
    ratio = (heading / propagated)[fine]
    assert fine.sum() > 600
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.quantile(ratio, 0.05) > 0.75
    assert np.quantile(ratio, 0.95) < 1.35


def one_degree(segments: ImageSegments) -> ImageSegments:
    """The segments with the table's noise."""
    count = len(segments)
    config = TableConfig()
    return replace(
        segments,
        sigma_middle_px=np.full(count, config.std_distance_px),
        sigma_angle_rad=np.full(count, config.std_angle_rad),
    )


@pytest.mark.parametrize("slope", ["level", "sloped"])
def test_tables_keep_true_pairs(slope: str) -> None:
    # Less than propagation does: near the horizon answers are not normal, and a spread is no zone.
    for noise, least in ((0.0, 0.999), (1.0, 0.93)):
        seen = views(np.random.default_rng(71), 5000, slope, noise=noise)
        errors = line_errors(CAMERA, seen.segments)
        direction, points = segment_lines(seen.wire_map, seen.rows)
        offset = points - [*seen.disc.centre, MOUNT.height_m]
        zones = heading_zones(errors.normals, errors.covariances, direction, np.zeros(5000), seen.disc, 2.0)
        table = build_table(CAMERA, slopes_of(direction, math.radians(5.0)), 0.4, TableConfig(samples=50))
        fits = table.fits(errors.normals, direction, offset, zones.roots, seen.disc, 2.0)
        assert fits.any(axis=1).mean() >= least


def test_a_line_and_its_reverse_have_the_same_spreads() -> None:
    seen = views(np.random.default_rng(72), 500, "sloped")
    errors = line_errors(CAMERA, seen.segments)
    direction, points = segment_lines(seen.wire_map, seen.rows)
    offset = points - [*seen.disc.centre, MOUNT.height_m]
    table = build_table(CAMERA, slopes_of(direction, math.radians(5.0)), 0.4, SMALL)
    fits = []
    for normals, ways in (
        (errors.normals, direction),
        (-errors.normals, direction),
        (errors.normals, -direction),
    ):
        zones = heading_zones(normals, errors.covariances, ways, np.zeros(500), seen.disc, 2.0)
        order = np.argsort(zones.roots % (2.0 * np.pi), axis=1)
        roots = np.take_along_axis(zones.roots, order, axis=1)
        spread = np.take_along_axis(table.spreads(normals, ways)[0], order, axis=1)
        kept = table.fits(normals, ways, offset, zones.roots, seen.disc, 2.0)
        fits.append((roots % (2.0 * np.pi), spread, np.take_along_axis(kept, order, axis=1)))
    for other in fits[1:]:
        same = np.abs(other[0] - fits[0][0]).max(axis=1) < 1e-6
        assert same.mean() > 0.98
        np.testing.assert_allclose(other[1][same], fits[0][1][same])
        np.testing.assert_array_equal(other[2][same], fits[0][2][same])


def test_a_table_is_made_once(built: list[Camera], cache: Path) -> None:
    wire_map = views(np.random.default_rng(73), 5, "sloped").wire_map
    first, second = (cached_table(CAMERA, wire_map, SMALL) for _ in range(2))
    assert len(built) == 1
    assert len(list(cache.glob("tolerances-*.npz"))) == 1
    np.testing.assert_array_equal(first.heading_std, second.heading_std)
    np.testing.assert_array_equal(first.circle_covariance, second.circle_covariance)
    np.testing.assert_array_equal(first.optical_from_level, second.optical_from_level)


def test_another_camera_noise_or_map_has_another_table(built: list[Camera]) -> None:
    sloped, level = (views(np.random.default_rng(74), 5, slope).wire_map for slope in ("sloped", "level"))
    cached_table(CAMERA, sloped, SMALL)
    cached_table(CAMERA, level, SMALL)
    cached_table(replace(CAMERA, std_focal=0.0), sloped, SMALL)
    cached_table(CAMERA, sloped, replace(SMALL, std_angle_rad=0.001))
    cached_table(replace(CAMERA, mount=replace(MOUNT, pitch_down_rad=0.2)), sloped, SMALL)
    assert len(built) == 5
    # A little more tilt is the same table, seen from another tilt.
    tilted = replace(CAMERA, mount=replace(MOUNT, pitch_down_rad=0.101))
    table = cached_table(tilted, sloped, SMALL)
    assert len(built) == 5
    assert not np.array_equal(
        table.optical_from_level, cached_table(CAMERA, sloped, SMALL).optical_from_level
    )


def test_a_broken_file_is_made_anew(
    built: list[Camera], cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    wire_map = views(np.random.default_rng(75), 5, "level").wire_map
    table = cached_table(CAMERA, wire_map, SMALL)
    (path,) = cache.glob("tolerances-*.npz")
    whole = path.read_bytes()
    for broken in (b"", whole[: len(whole) // 2], b"nonsense"):
        path.write_bytes(broken)
        again = cached_table(CAMERA, wire_map, SMALL)
        np.testing.assert_array_equal(again.heading_std, table.heading_std)
    assert len(built) == 4
    assert "made anew" in caplog.text
    assert [file.suffix for file in cache.iterdir()] == [".npz"]


def test_without_a_place_to_keep_it_the_table_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    wire_map = views(np.random.default_rng(76), 5, "level").wire_map
    assert np.isfinite(cached_table(CAMERA, wire_map, SMALL).heading_std).all()
