"""Viewpoints: what is seen from a few places, and which place stands for which pose."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from drawing import CAMERA, poses_inside, window_around

from maps.outcomes import SearchWindow
from maps.poses import Pose2
from maps.wiremap import WireMap
from vision.projection import Projector
from vision.viewpoints import viewpoints_in, views_from


def test_a_small_window_has_one_viewpoint_and_a_larger_one_five(toy_map: WireMap) -> None:
    projector, rows = Projector(CAMERA, toy_map), np.arange(len(toy_map))
    centre = Pose2(2.0, 4.5, 0.3)
    for dt_m, count in ((0.1, 1), (0.5, 5)):
        found = viewpoints_in(projector, SearchWindow(centre, dt_m, 0.2), rows)
        assert len(found) == len(found.places) == len(found.starts) - 1 == count
        np.testing.assert_array_equal(found.places[0], [2.0, 4.5])
        away = np.linalg.norm(found.places - found.places[0], axis=1)
        assert (away[1:] > 0.3 * dt_m).all()
        assert away.max() < dt_m
        assert found.starts[-1] == len(found.rows) == len(found.pieces)


def test_each_pose_goes_to_the_nearest_viewpoint(toy_map: WireMap) -> None:
    projector, rng = Projector(CAMERA, toy_map), np.random.default_rng(34)
    window = SearchWindow(Pose2(2.0, 4.5, 0.3), 0.5, 0.2)
    found = viewpoints_in(projector, window, np.arange(len(toy_map)))
    poses = np.array([window_around(window.centre, rng, 0.5, 0.2).centre.as_array() for _ in range(200)])
    nearest = found.nearest(poses)
    away = [np.hypot(poses[:, 0] - x, poses[:, 1] - y) for x, y in found.places]
    np.testing.assert_array_equal(np.choose(nearest, away), np.min(away, axis=0))
    assert set(nearest) == set(range(5))
    assert found.nearest(poses[:0]).shape == (0,)


@pytest.mark.parametrize(
    ("centre", "count"),
    [
        pytest.param(Pose2(0.1, 3.0, 0.0), 4, id="beside a wall"),
        pytest.param(Pose2(0.1, 0.1, 0.0), 3, id="in a corner"),
        pytest.param(Pose2(-0.1, 3.0, 0.0), 2, id="the centre itself off the floor"),
        pytest.param(Pose2(30.0, 30.0, 0.0), 1, id="outside the building"),
    ],
)
def test_places_off_the_floor_are_left_out_but_for_the_centre(
    toy_map: WireMap, centre: Pose2, count: int
) -> None:
    found = viewpoints_in(Projector(CAMERA, toy_map), SearchWindow(centre, 0.5, 0.2), np.arange(len(toy_map)))
    assert len(found) == count
    np.testing.assert_array_equal(found.places[0], [centre.x, centre.y])
    assert shapely.contains_xy(toy_map.floor, *found.places[1:].T).all()


def test_each_place_has_what_can_be_seen_from_it_alone(toy_map: WireMap) -> None:
    projector, rows = Projector(CAMERA, toy_map), np.arange(len(toy_map))
    places = np.array([[2.0, 4.5], [10.0, 1.0], [0.5, 0.5]])
    together = views_from(projector, places, [rows, rows[::3], rows[:0]])
    for number, own in enumerate([rows, rows[::3]]):
        part = slice(together.starts[number], together.starts[number + 1])
        alone = views_from(projector, places[number : number + 1], [own])
        assert set(alone.rows) <= set(own)
        assert len(alone.rows) > 5
        np.testing.assert_array_equal(together.rows[part], alone.rows)
        np.testing.assert_array_equal(together.pieces[part], alone.pieces)
    assert together.starts[3] == together.starts[2]


def test_all_that_a_prediction_shows_is_among_the_pieces_of_its_place(toy_map: WireMap) -> None:
    projector, rows = Projector(CAMERA, toy_map), np.arange(len(toy_map))
    for pose in poses_inside(toy_map, np.random.default_rng(35), 15):
        _, centre = CAMERA.map_from_optical(pose)
        seen = views_from(projector, centre[None, :2], [rows])
        predicted = projector.predict(pose, rows)
        ends = toy_map.endpoints[predicted.rows]
        shown = ends[:, :1] + predicted.spans[..., None] * (ends[:, 1:] - ends[:, :1])
        for row, (first, last) in zip(predicted.rows, shown, strict=True):
            own = seen.pieces[seen.rows == row]
            assert any(_on(first, *piece) and _on(last, *piece) for piece in own)
        # And it looks all around: more than one picture shows.
        assert len(seen.rows) > len(predicted)


def _on(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a point lies on a segment: the ways to both ends add up to its length."""
    way = np.linalg.norm(point - start) + np.linalg.norm(point - end)
    return bool(way < np.linalg.norm(end - start) + 1e-6)
