"""The camera: lens there and back, and which way is up."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE
from hypothesis import given
from hypothesis import strategies as st

from maps.poses import Array, Pose2
from vision.camera import Camera, CameraMount

LEVEL = replace(CAMERA, mount=CameraMount(height_m=1.0))
HOME = Pose2(0.0, 0.0, 0.0)


def pixel(camera: Camera, pose: Pose2, point: tuple[float, float, float]) -> Array:
    """Return where a point of the map lands, raw pixels (2,); it must lie ahead."""
    rotation, centre = camera.map_from_optical(pose)
    x, y, z = (np.array(point) - centre) @ rotation
    assert z > 0.0
    return camera.distort(np.array([[x / z, y / z]])).reshape(2)


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
def test_undistorting_the_whole_image_and_back_returns_it(camera: Camera) -> None:
    u, v = np.meshgrid(np.linspace(0, 639, 40), np.linspace(0, 479, 30))
    raw = np.column_stack([u.ravel(), v.ravel()])
    np.testing.assert_allclose(camera.distort(camera.undistort(raw)), raw, atol=1e-4)


@given(
    st.floats(-0.25, 0.25), st.floats(-0.05, 0.05), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3),
    st.floats(0.0, 0.75), st.floats(-math.pi, math.pi),
)  # fmt: skip
def test_radial_and_tangential_there_and_back(
    k1: float, k2: float, p1: float, p2: float, radius: float, bearing: float
) -> None:
    # Where the image no longer grows with the angle, an image point has two rays.
    r = np.linspace(0.0, 1.15 * radius, 50)
    if (1.0 + 3.0 * k1 * r**2 + 5.0 * k2 * r**4).min() < 0.2:
        return
    camera = replace(CAMERA, distortion=np.array([k1, k2, p1, p2, 0.0]))
    point = radius * np.array([[math.cos(bearing), math.sin(bearing)]])
    np.testing.assert_allclose(camera.undistort(camera.distort(point)), point, atol=2e-6)


@given(st.floats(-0.05, 0.1), st.floats(-0.02, 0.02), st.floats(0.0, 1.3), st.floats(-math.pi, math.pi))
def test_fisheye_there_and_back(k1: float, k2: float, angle: float, bearing: float) -> None:
    camera = replace(FISHEYE, distortion=np.array([k1, k2, 0.0, 0.0]))
    point = math.tan(angle) * np.array([[math.cos(bearing), math.sin(bearing)]])
    np.testing.assert_allclose(camera.undistort(camera.distort(point)), point, rtol=1e-5, atol=1e-7)


def test_the_principal_point_looks_straight_ahead() -> None:
    for camera in (CAMERA, BARREL, FISHEYE):
        np.testing.assert_allclose(camera.undistort(np.array([[camera.cx, camera.cy]])), [[0, 0]], atol=1e-12)


def test_no_points_are_no_trouble() -> None:
    for camera in (CAMERA, BARREL, FISHEYE):
        assert camera.undistort(np.zeros((0, 2))).shape == (0, 2)
        assert camera.distort(np.zeros((0, 2))).shape == (0, 2)


def test_ahead_left_and_up_are_middle_left_and_up_in_the_image() -> None:
    middle = pixel(LEVEL, HOME, (5.0, 0.0, 1.0))
    np.testing.assert_allclose(middle, [LEVEL.cx, LEVEL.cy], atol=1e-9)
    left, up = pixel(LEVEL, HOME, (5.0, 1.0, 1.0)), pixel(LEVEL, HOME, (5.0, 0.0, 2.0))
    np.testing.assert_allclose(left, middle - [LEVEL.fx / 5.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(up, middle - [0.0, LEVEL.fy / 5.0], atol=1e-9)


def test_pitch_down_moves_the_horizon_up_by_its_tangent() -> None:
    camera = replace(LEVEL, mount=replace(LEVEL.mount, pitch_down_rad=0.2))
    horizon = pixel(camera, HOME, (1e6, 0.0, 1.0))
    np.testing.assert_allclose(horizon, [camera.cx, camera.cy - camera.fy * math.tan(0.2)], atol=1e-6)


def test_yaw_to_the_left_moves_what_is_ahead_to_the_right() -> None:
    camera = replace(LEVEL, mount=replace(LEVEL.mount, yaw_rad=0.3))
    ahead = pixel(camera, HOME, (5.0, 0.0, 1.0))
    np.testing.assert_allclose(ahead, [camera.cx + camera.fx * math.tan(0.3), camera.cy], atol=1e-9)


def test_roll_turns_the_image_about_its_middle() -> None:
    # Positive about the optical axis, forward: the camera leans to its right, the world to its left.
    camera = replace(LEVEL, mount=replace(LEVEL.mount, roll_rad=0.1))
    up = pixel(camera, HOME, (5.0, 0.0, 2.0)) - [camera.cx, camera.cy]
    np.testing.assert_allclose(up, camera.fx / 5.0 * np.array([-math.sin(0.1), -math.cos(0.1)]), atol=1e-9)


def test_the_mount_moves_and_turns_with_the_robot() -> None:
    camera = replace(LEVEL, mount=CameraMount(0.3, 0.1, 1.4, pitch_down_rad=0.1, yaw_rad=-0.2))
    rotation, centre = camera.map_from_optical(Pose2(2.0, 3.0, math.pi / 2))
    np.testing.assert_allclose(centre, [2.0 - 0.1, 3.0 + 0.3, 1.4], atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    forward = rotation[:, 2]
    assert math.atan2(forward[1], forward[0]) == pytest.approx(math.pi / 2 - 0.2)
    assert forward[2] == pytest.approx(-math.sin(0.1))


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_projection_is_opencvs(camera: Camera) -> None:
    rotation, centre = camera.map_from_optical(Pose2(1.0, 2.0, 0.7))
    rng = np.random.default_rng(0)
    optical = rng.uniform([-1.0, -1.0, 2.0], [1.0, 1.0, 5.0], (50, 3))
    points = optical @ rotation.T + centre
    turn, shift = cv2.Rodrigues(rotation.T)[0], -rotation.T @ centre
    project = cv2.fisheye.projectPoints if camera is FISHEYE else cv2.projectPoints
    expected = project(points.reshape(-1, 1, 3), turn, shift, camera.matrix, camera.distortion)[0]
    np.testing.assert_allclose(
        camera.distort(optical[:, :2] / optical[:, 2:]), expected.reshape(-1, 2), atol=1e-6
    )
