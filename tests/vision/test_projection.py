"""Predicted pieces: on their segments, in the image, all of them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE, poses_inside

from maps.poses import Pose2
from maps.visibility import visible_spans
from maps.wiremap import WireMap
from vision.camera import Camera, CameraModel
from vision.pose import LineObservations, distances_and_jacobian
from vision.projection import MIN_PIECE_PX, NEAR_M, Prediction, Projector, line_normals

CAMERAS = pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])


def predictions(camera: Camera, wire_map: WireMap, count: int = 25) -> list[tuple[Pose2, Prediction]]:
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    poses = poses_inside(wire_map, np.random.default_rng(1), count)
    return [(pose, projector.predict(pose, rows)) for pose in poses]


@CAMERAS
def test_pieces_lie_on_their_segments_and_project_as_opencv_says(camera: Camera, toy_map: WireMap) -> None:
    pieces = 0
    project = cv2.fisheye.projectPoints if camera.model is CameraModel.FISHEYE else cv2.projectPoints
    for pose, predicted in predictions(camera, toy_map):
        rotation, centre = camera.map_from_optical(pose)
        rays = np.concatenate([predicted.ideal_px / camera.focal_px, np.ones((len(predicted), 2, 1))], axis=2)
        points = (rays * predicted.depths_m[..., None]) @ rotation.T + centre
        p, q = (toy_map.endpoints[predicted.rows, end][:, None] for end in (0, 1))
        share = ((points - p) * (q - p)).sum(axis=2) / ((q - p) ** 2).sum(axis=2)
        np.testing.assert_allclose(p + share[..., None] * (q - p), points, atol=1e-6)
        assert share.min() > -1e-9
        assert share.max() < 1.0 + 1e-9
        np.testing.assert_allclose(predicted.spans, share, atol=1e-6)
        turn, shift = cv2.Rodrigues(rotation.T)[0], -rotation.T @ centre
        expected = project(points.reshape(-1, 1, 3), turn, shift, camera.matrix, camera.distortion)[0]
        raw = camera.distort(predicted.ideal_px.reshape(-1, 2) / camera.focal_px)
        np.testing.assert_allclose(raw, expected.reshape(-1, 2), atol=1e-5)
        pieces += len(predicted)
    assert pieces > 100


def test_pieces_stay_in_the_image_in_front_of_the_camera_and_are_not_tiny(toy_map: WireMap) -> None:
    at_the_rim = 0
    for _, predicted in predictions(CAMERA, toy_map):
        raw = CAMERA.distort(predicted.ideal_px.reshape(-1, 2) / CAMERA.focal_px)
        assert raw.min() > -1e-6
        assert (raw < [639 + 1e-6, 479 + 1e-6]).all()
        assert predicted.depths_m.min() >= NEAR_M - 1e-9
        assert (predicted.lengths_px >= MIN_PIECE_PX).all()
        at_the_rim += int((np.abs(raw - [639, 479]) < 1e-6).any(axis=1).sum())
    assert at_the_rim > 10


def test_every_visible_point_in_the_image_is_on_a_piece(toy_map: WireMap) -> None:
    rng, checked = np.random.default_rng(2), 0
    for pose, predicted in predictions(CAMERA, toy_map):
        rotation, centre = CAMERA.map_from_optical(pose)
        which, spans = visible_spans(toy_map, centre, np.arange(len(toy_map)))
        place = spans[:, 0] + rng.uniform(0.1, 0.9, len(spans)) * (spans[:, 1] - spans[:, 0])
        p, q = toy_map.endpoints[which, 0], toy_map.endpoints[which, 1]
        optical = (p + place[:, None] * (q - p) - centre) @ rotation
        ideal = CAMERA.focal_px * optical[:, :2] / np.where(optical[:, 2:] > 0, optical[:, 2:], np.nan)
        raw = ideal + [CAMERA.cx, CAMERA.cy]
        # Far enough from the image's rim and the stretch's ends to be on a piece of 10 px or more.
        inside = (optical[:, 2] > 0.3) & ((raw > 20) & (raw < [620, 460])).all(axis=1)
        for row, point in zip(which[inside], ideal[inside], strict=True):
            own = predicted.ideal_px[predicted.rows == row]
            way = own[:, 1] - own[:, 0]
            length = np.linalg.norm(way, axis=1)
            along = ((point - own[:, 0]) * way).sum(axis=1) / length
            across = (way[:, 0] * (point - own[:, 0])[:, 1] - way[:, 1] * (point - own[:, 0])[:, 0]) / length
            on = (np.abs(across) < 1e-6) & (along > -1e-6) & (along < length + 1e-6)
            short = _image_length(toy_map, row, which, spans, rotation, centre) < 2 * MIN_PIECE_PX
            assert on.any() or short
            checked += not short
    assert checked > 150


def _image_length(
    toy_map: WireMap, row: int, which: np.ndarray, spans: np.ndarray, rotation: np.ndarray, centre: np.ndarray
) -> float:
    """The least image length of the row's visible stretches; zero where one reaches behind the camera."""
    p, q = toy_map.endpoints[row]
    optical = (p + spans[which == row][..., None] * (q - p) - centre) @ rotation
    if optical[..., 2].min() < 0.3:
        return 0.0
    ideal = CAMERA.focal_px * optical[..., :2] / optical[..., 2:]
    return float(np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1).min())


@CAMERAS
def test_normals_give_distances_in_pixels(camera: Camera, toy_map: WireMap) -> None:
    for _, predicted in predictions(camera, toy_map, 5):
        way = predicted.ideal_px[:, 1] - predicted.ideal_px[:, 0]
        beside = np.column_stack([-way[:, 1], way[:, 0]]) / predicted.lengths_px[:, None]
        for off in (0.0, 3.7, -12.0):
            points = predicted.ideal_px.mean(axis=1) + off * beside
            rays = np.column_stack([points, np.full(len(points), camera.focal_px)])
            distance = (predicted.normals * rays).sum(axis=1)
            np.testing.assert_allclose(distance, off, atol=1e-6)
        rays = np.concatenate([predicted.ideal_px, np.full((len(predicted), 2, 1), camera.focal_px)], axis=2)
        np.testing.assert_allclose(predicted.normals, line_normals(rays), atol=1e-9)


def test_a_segment_through_the_camera_has_a_finite_normal() -> None:
    ends = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, 4.0]], [[0.5, 0.0, 1.0], [0.5, 0.0, 1.0]]])
    assert np.isfinite(line_normals(ends)).all()


def test_a_margin_widens_the_image(toy_map: WireMap) -> None:
    pose, rows = Pose2(2.0, 1.5, 0.6), np.arange(len(toy_map))
    projector = Projector(CAMERA, toy_map)
    narrow, wide = projector.predict(pose, rows), projector.predict(pose, rows, margin_px=80.0)
    assert wide.lengths_px.sum() > narrow.lengths_px.sum() + 100.0
    assert wide.ideal_px[..., 0].max() == pytest.approx(639 - CAMERA.cx + 80.0)


@CAMERAS
def test_a_deviating_camera_is_predicted_as_the_estimator_sees_it(camera: Camera, toy_map: WireMap) -> None:
    """Height, pitch, roll, yaw, focal length and principal point off: no distance is left at that state."""
    deviations = np.array([0.03, 0.02, -0.015, 0.01, 0.02, 3.0, -4.0])
    projector, rows = Projector(camera, toy_map), np.arange(len(toy_map))
    for pose in poses_inside(toy_map, np.random.default_rng(3), 10):
        plain, bent = projector.predict(pose, rows), projector.predict(pose, rows, deviations=deviations)
        segments = bent.rows
        rays = np.concatenate([bent.ideal_px, np.full((len(bent), 2, 1), camera.focal_px)], axis=2)
        one = np.ones(len(bent))
        seen = LineObservations(projector.moments[segments], projector.directions[segments], rays, one, one)
        state = np.r_[pose.as_array(), deviations]
        np.testing.assert_allclose(distances_and_jacobian(state, camera, seen)[0], 0.0, atol=1e-6)
        np.testing.assert_allclose((bent.normals[:, None] * rays).sum(axis=2), 0.0, atol=1e-6)
        np.testing.assert_allclose(np.hypot(*bent.normals[:, :2].T), 1.0)
        none = projector.predict(pose, rows, deviations=np.zeros(7))
        np.testing.assert_allclose(none.ideal_px, plain.ideal_px, atol=1e-9)
        if len(bent):
            distance = distances_and_jacobian(np.r_[pose.as_array(), np.zeros(7)], camera, seen)[0]
            assert np.abs(distance).max() > 2.0


def test_no_rows_no_pieces(toy_map: WireMap) -> None:
    predicted = Projector(CAMERA, toy_map).predict(Pose2(2.0, 1.5, 0.6), np.zeros(0, np.int64))
    assert len(predicted) == 0
    assert predicted.ideal_px.shape == (0, 2, 2)
    assert predicted.normals.shape == (0, 3)


def test_only_the_rows_asked_for_are_predicted(toy_map: WireMap) -> None:
    projector, pose = Projector(CAMERA, toy_map), Pose2(2.0, 1.5, 0.6)
    whole = projector.predict(pose, np.arange(len(toy_map)))
    some = np.unique(whole.rows)[::2]
    part = projector.predict(pose, some)
    assert set(part.rows) == set(some)
    np.testing.assert_array_equal(part.ideal_px, whole.ideal_px[np.isin(whole.rows, some)])
