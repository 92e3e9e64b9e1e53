"""View regions: building time and memory, cache load, query time, and growth with the building.

`make bench` prints the table; rows of an office of 5, 20 and 60 rooms (the last is slow: a minute).
"""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from maps.documents import checked
from maps.mapdocument import MapDocument
from maps.mapfile import build_map, read_map
from maps.regioncache import cached_regions
from maps.regions import ViewRegions, build_regions
from maps.wiremap import WireMap
from tests.office import office

HEIGHTS_M = (1.2, 1.2)
SAMPLE = Path(__file__).resolve().parents[2] / "runs" / "samples" / "building_a" / "map.yaml"


def of_rooms(rooms: int) -> WireMap:
    return build_map(checked(MapDocument, office(rooms, lamps=7), "office"), Path("office"))


def places(regions: ViewRegions, count: int) -> list[tuple[float, float]]:
    rng = np.random.default_rng(1)
    numbers = rng.integers(len(regions), size=count).tolist()
    return [tuple(regions.region(number).corners.mean(axis=0).tolist()) for number in numbers]


def ask(regions: ViewRegions, points: list[tuple[float, float]]) -> int:
    """Windows of 0.75 m and 20 degrees, for a camera that sees 60 degrees."""
    spread = math.radians(20.0 + 30.0)
    return sum(len(regions.visible(point, 0.75, 1.0, spread)) for point in points)


@pytest.mark.parametrize("rooms", [0, 5, 20, 60], ids=["building_a", "5 rooms", "20 rooms", "60 rooms"])
def test_regions(benchmark, rooms, tmp_path, monkeypatch):
    """Times 100 queries; building, memory and cache are in the extra columns of the JSON, and printed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    wire_map = of_rooms(rooms) if rooms else read_map(SAMPLE)
    regions = cached_regions(wire_map, HEIGHTS_M)
    tracemalloc.start()
    again = cached_regions(wire_map, HEIGHTS_M)
    loaded_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    benchmark.extra_info.update(
        segments=len(wire_map),
        regions=len(regions),
        build_s=round(regions.build_seconds, 2),
        regions_mb=round(regions.memory_bytes / 1e6, 1),
        load_peak_mb=round(loaded_bytes / 1e6, 1),
    )
    points = places(again, 100)
    assert benchmark(ask, again, points) > 0
    print(rooms or "building_a", benchmark.extra_info)


def test_load(benchmark, tmp_path, monkeypatch):
    """Times reading the regions of the sample's map from the cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    wire_map = read_map(SAMPLE)
    built = cached_regions(wire_map, HEIGHTS_M)
    assert len(benchmark(cached_regions, wire_map, HEIGHTS_M)) == len(built)


def test_build(benchmark):
    """Times building the regions of the sample's map."""
    wire_map = read_map(SAMPLE)
    assert len(benchmark.pedantic(build_regions, (wire_map, HEIGHTS_M), rounds=2)) > 100
