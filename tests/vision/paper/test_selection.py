"""Selection by regions, and the order of appearance inside them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drawing import CAMERA, FISHEYE, poses_inside, window_around

from maps.outcomes import SearchWindow
from maps.partition import PartitionConfig
from maps.poses import Pose2
from maps.regions import ViewRegions, build_regions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.paper.binary import subtended
from vision.paper.order import order_of_appearance
from vision.paper.selection import half_field_of_view, select_segments, viewed_disc
from vision.projection import Projector


@pytest.fixture(scope="module")
def regions(toy_map: WireMap) -> ViewRegions:
    return build_regions(toy_map, (1.2, 1.2), PartitionConfig(surplus=0.0))


@pytest.mark.parametrize("camera", [CAMERA, FISHEYE], ids=["plain", "fisheye"])
def test_what_is_seen_from_the_window_is_selected(
    toy_map: WireMap, regions: ViewRegions, camera: Camera
) -> None:
    rng, every = np.random.default_rng(60), np.arange(len(toy_map))
    selected = []
    for pose in poses_inside(toy_map, rng, 150):
        window = window_around(pose, rng, 0.5, math.radians(15.0))
        found = select_segments(camera, toy_map, regions, window)
        seen = np.unique(Projector(camera, toy_map).predict(pose, every).rows)
        assert np.isin(seen, found.rows).all()
        selected.append(len(found.rows))
        np.testing.assert_array_equal(np.sort(np.concatenate([found.vertical, found.other])), found.rows)
    assert np.mean(selected) < 0.7 * len(toy_map)


def test_no_estimate_selects_all_regions(toy_map: WireMap, regions: ViewRegions) -> None:
    found = select_segments(CAMERA, toy_map, regions, SearchWindow(Pose2(5.0, 3.0, 0.0), 30.0, math.pi))
    assert len(found.regions) == len(regions)
    np.testing.assert_array_equal(found.rows, np.unique(regions.rows))


def test_verticals_are_vertical(toy_map: WireMap, regions: ViewRegions) -> None:
    found = select_segments(CAMERA, toy_map, regions, SearchWindow(Pose2(2.0, 1.5, 0.6), 0.3, 0.2))
    for rows, upright in ((found.vertical, True), (found.other, False)):
        ends = toy_map.endpoints[rows]
        assert len(rows) > 0
        assert ((np.ptp(ends[..., :2], axis=1).max(axis=1) < 1e-9) == upright).all()


def test_the_field_of_view_holds_all_rays() -> None:
    half = half_field_of_view(CAMERA)
    assert half == pytest.approx(math.atan2(322.0, 540.0 * math.cos(0.08) - 241.0 * math.sin(0.08)), abs=0.03)
    assert half >= math.atan(322.0 / 540.0)


def test_the_disc_is_the_cameras() -> None:
    rng = np.random.default_rng(61)
    window = SearchWindow(Pose2(1.0, 2.0, 3.0), 0.4, 0.5)
    disc = viewed_disc(CAMERA, window)
    for _ in range(500):
        turn, away = rng.uniform(-0.5, 0.5), rng.uniform(0.0, 0.4) * np.exp(1j * rng.uniform(-3.1, 3.1))
        pose = Pose2(1.0 + away.real, 2.0 + away.imag, 3.0 + turn)
        camera = pose @ Pose2(CAMERA.mount.x_m, CAMERA.mount.y_m, 0.0)
        assert np.hypot(*(disc.centre - [camera.x, camera.y])) <= disc.radius_m + 1e-12


def test_the_order_in_the_image_is_one_that_the_region_allows(toy_map: WireMap, regions: ViewRegions) -> None:
    rng, fixed, couples = np.random.default_rng(62), 0, 0
    middle = toy_map.endpoints.mean(axis=1)
    for pose in poses_inside(toy_map, rng, 60):
        window = SearchWindow(pose, 0.2, 0.3)
        found = select_segments(CAMERA, toy_map, regions, window)
        order = order_of_appearance(toy_map, regions, found.regions, found.vertical)
        camera = pose @ Pose2(CAMERA.mount.x_m, 0.0, 0.0)
        here = found.regions.tolist().index(regions.at((camera.x, camera.y)))
        bits = (order[..., here // 64] >> np.uint64(here % 64)) & np.uint64(1)
        seen = np.unique(Projector(CAMERA, toy_map).predict(pose, found.vertical).rows)
        level = np.searchsorted(found.vertical, seen)
        for i in level:
            assert bits[i, i]
            for k in level[level != i]:
                a, b = middle[found.vertical[i]], middle[found.vertical[k]]
                angle = subtended(a[0], a[1], b[0], b[1], camera.x, camera.y)
                if angle > 0.0:
                    assert bits[i, k]
                couples += 1
                fixed += bits[i, k] != bits[k, i]
    assert couples > 500
    # The order of most couples does not change inside a region.
    assert fixed > 0.8 * couples


def test_a_region_that_does_not_see_both_has_no_say(toy_map: WireMap, regions: ViewRegions) -> None:
    numbers = np.arange(len(regions))
    rows = np.flatnonzero(np.ptp(toy_map.endpoints[..., :2], axis=1).max(axis=1) < 1e-9)
    order = order_of_appearance(toy_map, regions, numbers, rows)
    assert order.shape[2] == -(-len(regions) // 64)
    for number in numbers[::7].tolist():
        bits = (order[..., number // 64] >> np.uint64(number % 64)) & np.uint64(1)
        unseen = ~np.isin(rows, regions.region(number).rows)
        assert not bits[unseen].any()
        assert not bits[:, unseen].any()
