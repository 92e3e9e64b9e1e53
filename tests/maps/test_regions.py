"""View regions: complete, tight, convex, with bearings that hold; against brute force by sight lines."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from maps.events import visibility_events
from maps.formats.imported import ImportOptions
from maps.formats.importing import import_map
from maps.mapfile import build_map, read_map
from maps.partition import convex_pieces
from maps.plan import plan_of
from maps.poses import wrap_angle
from maps.regions import ViewRegions, bearing_ranges, build_regions
from maps.visibility import visible_spans
from maps.wiremap import WireMap
from tests.sightlines import seen_by_sight_lines

HEIGHT_M = 1.2


@pytest.fixture(scope="module")
def regions(toy_map: WireMap) -> ViewRegions:
    return build_regions(toy_map, (HEIGHT_M, HEIGHT_M))


def places(wire_map: WireMap, count: int, seed: int) -> np.ndarray:
    """Random points of the floor, (count, 2)."""
    rng = np.random.default_rng(seed)
    low_x, low_y, high_x, high_y = wire_map.floor.bounds
    shapely.prepare(wire_map.floor)
    found = np.zeros((0, 2))
    while len(found) < count:
        points = rng.uniform([low_x, low_y], [high_x, high_y], (4 * count, 2))
        found = np.vstack([found, points[shapely.contains_xy(wire_map.floor, *points.T)]])
    return found[:count]


def shares(wire_map: WireMap, regions: ViewRegions, points: np.ndarray) -> tuple[list[str], float]:
    """What the lists miss, and how long they are against what the points themselves see."""
    missed, listed, visible = [], 0, 0
    seen = seen_by_sight_lines(wire_map, points, regions.heights_m[0])
    for point, truly in zip(points, seen, strict=True):
        number = regions.at(tuple(point))
        assert number is not None
        rows = regions.region(number).rows
        missed += [f"{wire_map.names[row]} from {point}" for row in np.setdiff1d(np.flatnonzero(truly), rows)]
        listed, visible = listed + len(rows), visible + int(truly.sum())
    return missed, listed / visible


def test_cells_are_convex_and_cover_the_floor_once(toy_map, regions):
    cells = [shapely.Polygon(regions.region(k).corners) for k in range(len(regions))]
    assert all(cell.convex_hull.area - cell.area < 1e-9 and cell.exterior.is_ccw for cell in cells)
    assert sum(cell.area for cell in cells) == pytest.approx(toy_map.floor.area, rel=1e-9)
    assert shapely.union_all(cells).symmetric_difference(toy_map.floor).area < 1e-6


def test_no_visible_segment_is_missing(toy_map, regions):
    missed, ratio = shares(toy_map, regions, places(toy_map, 600, seed=3))
    assert not missed
    assert ratio < 1.5


def test_exact_visibility_agrees(toy_map, regions):
    every = np.arange(len(toy_map))
    for x, y in places(toy_map, 300, seed=4):
        seen = every[visible_spans(toy_map, np.array([x, y, HEIGHT_M]), every)[0]]
        assert np.isin(seen, regions.region(regions.at((x, y))).rows).all()


def test_a_range_of_heights_sees_what_each_height_sees(toy_map):
    both = build_regions(toy_map, (0.3, 2.0))
    every = np.arange(len(toy_map))
    for height in (0.3, 1.0, 2.0):
        for x, y in places(toy_map, 60, seed=5):
            seen = every[visible_spans(toy_map, np.array([x, y, height]), every)[0]]
            assert np.isin(seen, both.region(both.at((x, y))).rows).all()


def test_bearings_lie_in_their_ranges(toy_map, regions):
    for x, y in places(toy_map, 200, seed=6):
        region = regions.region(regions.at((x, y)))
        for ends, (low, high) in zip(toy_map.endpoints[region.rows], region.ranges, strict=True):
            bearings = np.arctan2(ends[:, 1] - y, ends[:, 0] - x)
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            assert (np.abs(wrap_angle(bearings - middle)) <= half + 1e-9).all()
            assert -math.pi < low <= math.pi
            assert low <= high <= low + 2.0 * math.pi


def test_ranges_across_the_cut():
    cell = np.array([[10.0, -1.0], [11.0, -1.0], [11.0, 1.0], [10.0, 1.0]])
    wall = np.array([[[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]])
    ((low, high),) = bearing_ranges(cell, wall)
    assert low == pytest.approx(math.pi - math.atan2(1.5, 10.0))
    assert high == pytest.approx(math.pi + math.atan2(1.5, 10.0))


def test_a_segment_through_the_cell_is_all_around():
    cell = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    lamp = np.array([[[0.5, 0.5, 2.5], [3.0, 0.5, 2.5]]])
    ((low, high),) = bearing_ranges(cell, lamp)
    assert high - low == pytest.approx(2.0 * math.pi)


def test_windows_select_by_place_and_bearing(toy_map, regions):
    point = tuple(places(toy_map, 1, seed=8)[0])
    around = regions.visible(point, 0.3, 0.0, math.pi)
    by_cells = [regions.region(k).rows for k in regions.touching(point, 0.3).tolist()]
    assert np.array_equal(around, np.unique(np.concatenate(by_cells)))
    ahead = regions.visible(point, 0.3, 0.0, 0.2)
    assert 0 < len(ahead) < len(around)
    assert np.isin(ahead, around).all()


def test_a_point_off_the_floor_has_the_nearest_region(toy_map, regions):
    far = (toy_map.floor.bounds[0] - 5.0, toy_map.floor.bounds[1] - 5.0)
    assert regions.at(far) is None
    assert len(regions.touching(far, 0.1)) >= 1


def test_every_event_ends_on_a_corner_that_juts_out(toy_map):
    plan = plan_of(toy_map)
    events = visibility_events(plan)
    corners = {tuple(np.round(wall[1], 6)) for wall in plan.walls}
    assert len(events.lines)
    assert {tuple(np.round(line[0], 6)) for line in events.lines} <= corners
    assert events.starts[-1] == len(events.rows)


def test_an_empty_room_is_one_cell():
    square = shapely.MultiPolygon([shapely.box(0.0, 0.0, 4.0, 3.0)])
    (piece,) = convex_pieces(square)
    assert shapely.Polygon(piece).equals(shapely.box(0.0, 0.0, 4.0, 3.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "rendered/building_a/map.yaml",
        "rendered/building_b/map.yaml",
        "rendered/building_0001/map.yaml",
        "rendered/building_0002/map.yaml",
        "map_samples/building_a.dxf",
        "map_samples/lab.yaml",
        "map_samples/sample_house.ifc",
        "map_samples/turtlebot3_house.sdf",
    ],
)
def test_sample_maps_at_many_points(data: Path, name: str):
    path = data / name
    foreign = path.parent.name == "map_samples"
    wire_map = build_map(import_map(path, ImportOptions()).document, path) if foreign else read_map(path)
    found = build_regions(wire_map, (HEIGHT_M, HEIGHT_M))
    missed, ratio = shares(wire_map, found, places(wire_map, 20_000, seed=9))
    print(f"{name}: {len(found)} regions, misses {len(missed)}, ratio {ratio:.3f}")
    assert not missed
    assert ratio <= 1.3
