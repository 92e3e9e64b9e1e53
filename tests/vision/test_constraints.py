"""Unary constraints: no true pair is ever rejected, its position line and heading are right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, FISHEYE, MOUNT, exact_lines, poses_inside, window_around
from toy_building import Building

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2, wrap_angle
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import (
    Correspondences,
    camera_centre,
    level_normals,
    position_lines,
    unary_correspondences,
)
from vision.projection import Projector

TILTED = replace(FISHEYE, mount=replace(MOUNT, y_m=-0.2, yaw_rad=0.5, roll_rad=0.1, pitch_down_rad=-0.2))
CAMERAS = pytest.mark.parametrize("camera", [CAMERA, TILTED], ids=["plain", "tilted"])


@pytest.fixture(scope="module")
def thicket(tmp_path_factory: pytest.TempPathFactory) -> WireMap:
    """Return 80 segments in all directions, every fourth upright, in an empty hall of 8 x 8 m."""
    rng = np.random.default_rng(0)
    starts = rng.uniform([0.2, 0.2, 0.0], [7.8, 7.8, 3.0], (80, 3))
    ends = np.clip(starts + rng.normal(0.0, 1.0, (80, 3)), [0.1, 0.1, 0.0], [7.9, 7.9, 3.0])
    ends[::4] = starts[::4] + [0.0, 0.0, 1.0]
    segments: list[dict[str, object]] = [
        {"p0": p.tolist(), "p1": q.tolist()} for p, q in zip(starts, ends, strict=True)
    ]
    hall: list[dict[str, object]] = [{"outer": [(0, 0), (8, 0), (8, 8), (0, 8)]}]
    return Building(segments, hall, [], []).read(tmp_path_factory.mktemp("thicket"))


def pairs_in(
    camera: Camera, wire_map: WireMap, pose: Pose2, window: SearchWindow
) -> tuple[Correspondences, list[tuple[int, int]]]:
    """Return the pairs that pass, and the true ones (row, line) that the window's centre predicts at all.

    Left out are edges nearer than the window is wide: a step aside can move their images anywhere.
    """
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    true = projector.predict(pose, rows)
    margin = camera.focal_px * math.tan(window.dphi_rad)
    predicted = projector.predict(window.centre, rows, margin)
    found = unary_correspondences(camera, wire_map, exact_lines(camera, true), predicted, window)
    fair = np.isin(true.rows, predicted.rows) & (true.depths_m.min(axis=1) > 2.0 * window.dt_m + 0.5)
    return found, [(int(true.rows[line]), int(line)) for line in np.flatnonzero(fair)]


@CAMERAS
@pytest.mark.parametrize(("dt_m", "dphi_deg"), [(0.05, 2.0), (0.3, 10.0), (0.75, 20.0), (1.5, 40.0)])
def test_no_true_pair_is_rejected(camera: Camera, thicket: WireMap, dt_m: float, dphi_deg: float) -> None:
    rng = np.random.default_rng(7)
    count = 0
    for pose in poses_inside(thicket, rng, 60):
        found, true = pairs_in(camera, thicket, pose, window_around(pose, rng, dt_m, math.radians(dphi_deg)))
        assert set(true) <= set(zip(found.rows.tolist(), found.lines.tolist(), strict=True))
        count += len(true)
    assert count > 150


@CAMERAS
def test_in_the_toy_building_hardly_any_true_pair_is_rejected(camera: Camera, toy_map: WireMap) -> None:
    # Where a corner hides different stretches of an edge from the pose and from the window's centre, the
    # line may lie beyond the predicted piece's reach.
    rng = np.random.default_rng(8)
    lost = count = 0
    for pose in poses_inside(toy_map, rng, 80):
        found, true = pairs_in(camera, toy_map, pose, window_around(pose, rng, 0.3, math.radians(10.0)))
        lost += len(set(true) - set(zip(found.rows.tolist(), found.lines.tolist(), strict=True)))
        count += len(true)
    assert count > 500
    assert lost <= 0.003 * count


@CAMERAS
def test_position_lines_of_true_pairs_pass_through_the_camera(camera: Camera, thicket: WireMap) -> None:
    for pose in poses_inside(thicket, np.random.default_rng(9), 30):
        true = Projector(camera, thicket).predict(pose, np.arange(len(thicket)))
        normals = level_normals(camera, exact_lines(camera, true))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
        points = thicket.endpoints[true.rows].mean(axis=1)
        line, offset = position_lines(camera, normals, points, np.full(len(true), pose.phi))
        # Where the plane is nearly level its trace in the plan is far away and uncertain.
        steep = np.linalg.norm(normals[:, :2], axis=1) > 0.05
        np.testing.assert_allclose((line @ camera_centre(camera, pose) - offset)[steep], 0.0, atol=1e-6)


@CAMERAS
def test_the_heading_of_a_true_pair_is_a_root(camera: Camera, thicket: WireMap) -> None:
    rng, errors = np.random.default_rng(10), []
    for pose in poses_inside(thicket, rng, 40):
        window = window_around(pose, rng, 0.05, math.radians(1.0))
        found, true = pairs_in(camera, thicket, pose, window)
        heading = dict(zip(zip(found.rows, found.lines, strict=True), found.phi, strict=True))
        errors += [wrap_angle(heading[pair] - pose.phi) for pair in true if np.isfinite(heading[pair])]
    assert len(errors) > 200
    # In so narrow a window the other root is hardly ever inside, too.
    assert np.quantile(np.abs(errors), 0.98) < 1e-6
    assert np.abs(errors).max() <= math.radians(2.0)


def test_upright_segments_have_no_heading_and_others_have(toy_map: WireMap) -> None:
    pose = Pose2(2.0, 1.5, 0.6)
    found, _ = pairs_in(CAMERA, toy_map, pose, SearchWindow(pose, 0.3, 0.2))
    ends = toy_map.endpoints[found.rows]
    upright = np.abs(ends[:, 1, :2] - ends[:, 0, :2]).max(axis=1) == 0.0
    assert upright.any()
    assert not upright.all()
    np.testing.assert_array_equal(np.isnan(found.phi), upright)


def test_pairs_are_distinct(toy_map: WireMap) -> None:
    pose = Pose2(2.0, 1.5, 0.6)
    found, _ = pairs_in(CAMERA, toy_map, pose, SearchWindow(pose, 0.5, 0.4))
    assert len(set(zip(found.rows, found.lines, strict=True))) == len(found)


def test_wrong_pairs_far_away_are_rejected(toy_map: WireMap) -> None:
    rng, passed, possible = np.random.default_rng(11), 0, 0
    rows = np.arange(len(toy_map))
    for pose in poses_inside(toy_map, rng, 20):
        projector, window = Projector(CAMERA, toy_map), SearchWindow(pose, 0.1, math.radians(3.0))
        true = projector.predict(pose, rows)
        lines = exact_lines(CAMERA, true)
        found = unary_correspondences(CAMERA, toy_map, lines, true, window)
        middle = true.ideal_px.mean(axis=1)
        for row, line in zip(found.rows, found.lines, strict=True):
            own = true.ideal_px[true.rows == row]
            passed += bool(_distance(middle[line], own).min() > 200.0)
        possible += len(true) * (len(true) - 1)
    assert possible > 1000
    assert passed == 0


def test_an_upright_edge_does_not_take_a_slanted_line(toy_map: WireMap) -> None:
    pose = Pose2(2.0, 1.5, 0.6)
    projector = Projector(CAMERA, toy_map)
    row = np.array([toy_map.names.index("pillar/corner1")])
    true = projector.predict(pose, row)
    lines = exact_lines(CAMERA, true)
    window = SearchWindow(pose, 0.3, 0.17)
    assert len(unary_correspondences(CAMERA, toy_map, lines, true, window)) == 1
    lean = np.array([[np.cos(0.06), -np.sin(0.06)], [np.sin(0.06), np.cos(0.06)]])
    middle = lines.ideal_px.mean(axis=1, keepdims=True)
    slanted = replace(lines, ideal_px=(lines.ideal_px - middle) @ lean + middle)
    assert len(unary_correspondences(CAMERA, toy_map, slanted, true, window)) == 0


def test_no_lines_no_pairs(toy_map: WireMap) -> None:
    projector, pose = Projector(CAMERA, toy_map), Pose2(2.0, 1.5, 0.6)
    none = projector.predict(pose, np.zeros(0, np.int64))
    some = projector.predict(pose, np.arange(len(toy_map)))
    window = SearchWindow(pose, 0.3, 0.2)
    assert len(unary_correspondences(CAMERA, toy_map, exact_lines(CAMERA, none), some, window)) == 0
    assert len(unary_correspondences(CAMERA, toy_map, exact_lines(CAMERA, some), none, window)) == 0


def _distance(point: Array, pieces: Array) -> Array:
    """Distances of a point (2,) from pieces (P, 2, 2)."""
    way = pieces[:, 1] - pieces[:, 0]
    share = np.clip(((point - pieces[:, 0]) * way).sum(axis=1) / (way**2).sum(axis=1), 0.0, 1.0)
    result: Array = np.linalg.norm(pieces[:, 0] + share[:, None] * way - point, axis=1)
    return result
