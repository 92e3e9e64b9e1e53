"""The coarse score: nearness as it says, a peak at the true pose, each pose on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE, exact_lines, poses_inside, segments_at

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.linefield import FieldConfig, LineField, field_scores, line_field
from vision.projection import Projector
from vision.viewpoints import Viewpoints, views_from

CONFIG = FieldConfig()
SIGMA_PX = 0.5
WIDTH_PX = float(np.sqrt(CONFIG.kernel_px**2 + SIGMA_PX**2 + CAMERA.shift_px**2))
BINS = 48
POSE = Pose2(2.0, 5.5, -0.9)
SHIFTS = [
    (0.15, 0, 0),
    (-0.15, 0, 0),
    (0, 0.15, 0),
    (0, -0.15, 0),
    (0, 0, 0.05),
    (0, 0, -0.05),
    (0.2, 0.2, 0.1),
]


def field_of(projector: Projector, *ends: tuple[float, float, float, float]) -> LineField:
    return line_field(segments_at(np.array(ends).reshape(-1, 2, 2)), projector, CONFIG.kernel_px)


def middles(field: LineField) -> Array:
    """Return the cells' middles (rows, columns, 2), ideal pixels."""
    rows, columns = np.indices(field.nearness.shape[1:])
    return np.asarray(field.origin_px) + field.cell_px * (np.stack([columns, rows], axis=2) + 0.5)


def distances(points: Array, ends: Array) -> Array:
    """Return how far points (..., 2) are from a segment (2, 2)."""
    way = ends[1] - ends[0]
    along = np.clip(((points - ends[0]) @ way) / (way @ way), 0.0, 1.0)
    result: Array = np.linalg.norm(points - (ends[0] + along[..., None] * way), axis=-1)
    return result


def scores(projector: Projector, field: LineField, seen: Viewpoints, poses: Array) -> Array:
    return field_scores(field, projector, seen, poses, np.zeros(len(poses), np.int64), CONFIG)


def looking(camera: Camera, wire_map: WireMap, pose: Pose2) -> tuple[Projector, LineField, Viewpoints]:
    """Return a projector, the field of exact lines as seen from a pose, and what is seen there all around."""
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    lines = exact_lines(camera, projector.predict(pose, rows))
    seen = views_from(projector, camera_place(camera, pose), [rows])
    return projector, line_field(lines, projector, CONFIG.kernel_px), seen


def camera_place(camera: Camera, pose: Pose2) -> Array:
    """Return where the camera is, in plan, (1, 2)."""
    return camera.map_from_optical(pose)[1][None, :2]


def pieces_only(*pieces: Array) -> Viewpoints:
    """Return one viewpoint that sees these pieces (2, 3), as of the map's first segments."""
    rows = np.arange(len(pieces))
    return Viewpoints(np.zeros((1, 2)), rows, np.array(pieces).reshape(-1, 2, 3), np.array([0, len(pieces)]))


def rich_poses(camera: Camera, wire_map: WireMap, count: int, seed: int) -> list[Pose2]:
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    poses = poses_inside(wire_map, np.random.default_rng(seed), 4 * count)
    return [pose for pose in poses if len(projector.predict(pose, rows)) >= 12][:count]


@pytest.mark.parametrize(
    "ends",
    [
        (-200.0, -100.0, 150.0, 120.0),
        (100.0, 180.0, -250.0, 180.0),
        (30.0, -200.0, 30.0, 150.0),
        (250.0, -50.0, 240.0, -90.0),
        (280.0, 200.0, 500.0, 300.0),  # half of it outside the image
    ],
)
def test_nearness_is_one_on_a_line_and_falls_off_as_a_gaussian(
    toy_map: WireMap, ends: tuple[float, float, float, float]
) -> None:
    field = field_of(Projector(CAMERA, toy_map), ends)
    own = field.nearness.max(axis=(1, 2)) > 0
    assert own.sum() == 2
    line = np.array(ends).reshape(2, 2)
    away = distances(middles(field), line)
    for nearness in field.nearness[own] / 255.0:
        expected = np.exp(-0.5 * (away / WIDTH_PX) ** 2)
        inside = away < 2.4 * WIDTH_PX
        np.testing.assert_allclose(nearness[inside], expected[inside], atol=1.1 / 255.0)
        assert nearness[~inside].max() <= 0.06
        assert nearness.max() > 0.93


def test_two_lines_are_each_as_near_as_alone(toy_map: WireMap) -> None:
    projector = Projector(CAMERA, toy_map)
    first, second = (-200.0, -100.0, 150.0, -90.0), (-180.0, -95.0, 250.0, -80.0)
    together = field_of(projector, first, second).nearness
    alone = [field_of(projector, line).nearness for line in (first, second)]
    np.testing.assert_array_equal(together, np.maximum(*alone))


def test_a_line_is_drawn_into_the_directions_next_to_its_own_bright_side_on_the_right(
    toy_map: WireMap,
) -> None:
    projector = Projector(CAMERA, toy_map)
    for turn in np.linspace(-np.pi, np.pi, 31):
        way = 150.0 * np.array([np.cos(turn), np.sin(turn)])
        for polarity in (1.0, -1.0):
            lines = segments_at(np.array([[-way, way]]))
            lines = replace(lines, polarity=polarity * lines.polarity)
            field = line_field(lines, projector, CONFIG.kernel_px)
            found = np.flatnonzero(field.nearness.max(axis=(1, 2))) * 2.0 * np.pi / BINS
            away = np.angle(np.exp(1j * (found - turn - (0.0 if polarity > 0.0 else np.pi))))
            assert len(found) == 2
            assert np.abs(away).max() <= 2.0 * np.pi / BINS + 1e-9


def test_chance_is_the_mean_nearness_within_bounds(toy_map: WireMap) -> None:
    projector = Projector(CAMERA, toy_map)
    field = field_of(projector, *[(-300.0, v, 300.0, v) for v in np.arange(-200.0, 200.0, 25.0)])
    mean = field.nearness.mean(axis=(1, 2)) / 255.0
    assert mean.max() > 0.1
    np.testing.assert_allclose(field.chance, np.clip(mean, 0.01, 0.5))
    np.testing.assert_array_equal(field_of(projector).chance, 0.01)


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
def test_scores_of_exact_lines_peak_at_the_true_pose(camera: Camera, toy_map: WireMap) -> None:
    for pose in rich_poses(camera, toy_map, 10, 31):
        projector, field, seen = looking(camera, toy_map, pose)
        found = scores(projector, field, seen, pose.as_array() + np.array([(0.0, 0.0, 0.0), *SHIFTS]))
        assert found.shape == (1 + len(SHIFTS),)
        assert found.argmax() == 0
        assert found[0] > 30.0


def test_scores_do_not_depend_on_the_company(toy_map: WireMap) -> None:
    projector, field, seen = looking(CAMERA, toy_map, POSE)
    poses = POSE.as_array() + np.random.default_rng(32).normal(0.0, 0.1, (300, 3))
    together = scores(projector, field, seen, poses)
    alone = [scores(projector, field, seen, row[None])[0] for row in poses[::40]]
    np.testing.assert_array_equal(together[::40], alone)
    np.testing.assert_array_equal(scores(projector, field, seen, poses[::-1]), together[::-1])
    assert scores(projector, field, seen, poses[:0]).shape == (0,)


def test_each_pose_is_judged_by_its_own_viewpoint(toy_map: WireMap) -> None:
    projector, field, _ = looking(CAMERA, toy_map, POSE)
    rows = np.arange(len(toy_map))
    places = np.concatenate([camera_place(CAMERA, POSE), [[1.0, 3.0], [10.0, 1.0]]])
    each = [views_from(projector, place[None], [rows]) for place in places]
    poses = POSE.as_array() + np.random.default_rng(36).normal(0.0, 0.05, (30, 3))
    views = np.arange(30) % 3
    found = field_scores(field, projector, views_from(projector, places, [rows] * 3), poses, views, CONFIG)
    for number, seen in enumerate(each):
        np.testing.assert_array_equal(
            found[views == number], scores(projector, field, seen, poses[views == number])
        )
    assert found[views == 0].mean() > found[views == 2].mean() + 10.0


def test_edges_bright_on_the_wrong_side_support_little(toy_map: WireMap) -> None:
    for pose in rich_poses(CAMERA, toy_map, 8, 33):
        _, field, seen = looking(CAMERA, toy_map, pose)
        # Exact lines run as their segments do, brighter on the right.
        maps = [replace(toy_map, polarity=np.full(len(toy_map), side)) for side in (0.0, 1.0, -1.0)]
        unknown, right, wrong = (
            scores(Projector(CAMERA, known), field, seen, pose.as_array()[None])[0] for known in maps
        )
        assert wrong < 0.5 * unknown
        assert right > 0.5 * unknown > 10.0


def test_a_piece_outside_the_image_neither_helps_nor_harms(toy_map: WireMap) -> None:
    projector, field, seen = looking(CAMERA, toy_map, POSE)
    rotation, centre = CAMERA.map_from_optical(POSE)
    # Behind, to the left, to the right, above, below, and too near.
    places = [(0, 0, -2), (-3, 0, 2), (3, 0, 2), (0, -3, 2), (0, 3, 2), (0, 0, 0.1)]
    ends = np.array([[0.0, -0.05, 0.0], [0.02, 0.05, 0.0]])
    outside = [centre + (np.array(place) + ends) @ rotation.T for place in places]
    poses = POSE.as_array()[None]
    np.testing.assert_array_equal(scores(projector, field, pieces_only(*outside), poses), 0.0)
    more = pieces_only(*seen.pieces, *outside)
    np.testing.assert_array_equal(
        scores(projector, field, more, poses), scores(projector, field, pieces_only(*seen.pieces), poses)
    )


def test_what_reaches_beyond_the_image_is_judged_by_the_part_inside(toy_map: WireMap) -> None:
    projector = Projector(CAMERA, toy_map)
    rotation, centre = CAMERA.map_from_optical(POSE)
    rim = float(projector.bounds[1])
    field = field_of(projector, (0.0, 27.0, rim * CAMERA.focal_px, 27.0))
    whole, beyond = (
        scores(
            projector,
            field,
            pieces_only(centre + np.array([[0.0, 0.1, 2.0], [reach, 0.1, 2.0]]) @ rotation.T),
            POSE.as_array()[None],
        )[0]
        for reach in (2.0 * rim, 5.0)
    )
    assert beyond == pytest.approx(whole, rel=1e-6)
    assert whole > 5.0


def test_an_edge_not_seen_costs_more_where_the_map_has_learnt_that_it_shows(toy_map: WireMap) -> None:
    projector, _, seen = looking(CAMERA, toy_map, POSE)
    blank = field_of(projector)
    unknown, same, rare, sure = (
        scores(
            Projector(CAMERA, replace(toy_map, detection_rate=np.full(len(toy_map), rate))),
            blank,
            seen,
            POSE.as_array()[None],
        )[0]
        for rate in (np.nan, CONFIG.detection_rate, 0.1, 0.9)
    )
    assert sure < unknown == same < rare < 0.0
