"""The cache of view regions: the same regions, for this map only, whatever happens to the file."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import maps.regioncache
from maps.poses import frozen
from maps.regioncache import cache_folder, cached_regions
from maps.regions import ViewRegions
from maps.wiremap import WireMap

HEIGHTS_M = (1.0, 1.0)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "wireloc"


@pytest.fixture
def builds(monkeypatch) -> list[WireMap]:
    """The maps whose regions were built, in order."""
    built: list[WireMap] = []
    build = maps.regioncache.build_regions

    def counted(wire_map, heights_m, config):
        built.append(wire_map)
        return build(wire_map, heights_m, config)

    monkeypatch.setattr(maps.regioncache, "build_regions", counted)
    return built


def same(regions: ViewRegions, other: ViewRegions) -> bool:
    names = ("corners", "corner_starts", "rows", "ranges", "row_starts")
    return all(np.array_equal(getattr(regions, name), getattr(other, name)) for name in names)


def test_the_second_time_is_read(toy_map, builds):
    first, second = cached_regions(toy_map, HEIGHTS_M), cached_regions(toy_map, HEIGHTS_M)
    assert len(builds) == 1
    assert same(first, second)
    assert second.at(tuple(first.region(0).corners.mean(axis=0))) == 0


def test_another_map_or_height_is_built(toy_map, builds):
    cached_regions(toy_map, HEIGHTS_M)
    cached_regions(toy_map, (1.1, 1.1))
    moved = toy_map.endpoints.copy()
    moved[0, 0, 2] += 0.01
    cached_regions(replace(toy_map, endpoints=frozen(moved)), HEIGHTS_M)
    assert len(builds) == 3


@pytest.mark.parametrize("damage", ["empty", "cut", "text"])
def test_a_damaged_file_is_built_anew(toy_map, builds, cache, damage):
    regions = cached_regions(toy_map, HEIGHTS_M)
    (path,) = cache.glob("regions-*.npz")
    whole = path.read_bytes()
    path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "text": b"not an archive"}[damage])
    assert same(cached_regions(toy_map, HEIGHTS_M), regions)
    assert len(builds) == 2
    assert len(path.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_only_costs_time(toy_map, builds, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert len(cached_regions(toy_map, HEIGHTS_M)) == len(cached_regions(toy_map, HEIGHTS_M))
    assert len(builds) == 2


def build_once(wire_map: WireMap) -> int:
    return len(cached_regions(wire_map, HEIGHTS_M))


def test_two_processes_at_once(toy_map, cache):
    with ProcessPoolExecutor(2) as pool:
        counts = list(pool.map(build_once, [toy_map] * 4))
    assert len(set(counts)) == 1
    assert len(list(cache.glob("regions-*.npz"))) == 1
    assert not list(cache.glob("*.tmp"))


def test_the_folder_is_the_users_own(tmp_path):
    assert cache_folder() == tmp_path / "wireloc"
