"""Lines as measurements of pose, mount and map: slopes against small differences, and matching again."""

from __future__ import annotations

import numpy as np
import pytest
from toy_building import toy_building

from maps.poses import Pose2
from vision.camera import Camera, CameraModel, CameraMount
from vision.measurements import LineMeasurements
from vision.projection import Projector
from vision.refinement import RefinementConfig
from vision.seenlines import (
    MOUNT,
    MapLines,
    SeenLines,
    line_residuals,
    look_again,
    mount_values,
    with_mount,
)

MOUNTED = CameraMount(0.12, -0.03, 1.1, 0.1, 0.05, -0.02)
CAMERA = Camera(CameraModel.PINHOLE_RADTAN, 640, 480, 500.0, 500.0, 319.5, 239.5, np.zeros(5), MOUNTED)
POSES = (Pose2(1.2, 1.5, 0.4), Pose2(6.5, 2.0, 2.9))


@pytest.fixture(scope="module")
def wire_map(tmp_path_factory):
    return toy_building().read(tmp_path_factory.mktemp("toy"))


def seen_from(wire_map, pose):
    predicted = Projector(CAMERA, wire_map).predict(pose, np.arange(len(wire_map)))
    rays = np.concatenate([predicted.ideal_px, np.full((len(predicted), 2, 1), CAMERA.focal_px)], axis=2)
    count = len(predicted)
    return SeenLines(
        np.zeros(count, np.int64), predicted.rows, rays, np.full(count, 0.4), np.full(count, 0.7)
    )


def test_residuals_vanish_at_the_truth(wire_map):
    seen = SeenLines.joined([seen_from(wire_map, pose) for pose in POSES])
    frames = np.zeros((2, 5))
    frames[:, :3] = [pose.as_array() for pose in POSES]
    nothing = np.zeros((len(wire_map), 2))
    residuals, _ = line_residuals(CAMERA, frames, seen, MapLines.of(wire_map), nothing)
    assert len(residuals) > 30
    np.testing.assert_allclose(residuals, 0.0, atol=1e-7)


def test_slopes_are_those_of_small_differences(wire_map):
    rng = np.random.default_rng(4)
    segments = MapLines.of(wire_map)
    seen = SeenLines.joined([seen_from(wire_map, pose) for pose in POSES])
    frames = np.zeros((2, 5))
    frames[:, :3] = [pose.as_array() for pose in POSES]
    frames += rng.normal(size=(2, 5)) * 0.01
    mount = mount_values(MOUNTED) + rng.normal(size=6) * 0.01
    shifts = rng.normal(size=(len(wire_map), 2)) * 0.01

    def residuals(column, step):
        moved, turned, placed = frames.copy(), mount.copy(), shifts.copy()
        if column < 5:
            moved[:, column] += step
        elif column < 11:
            turned[column - 5] += step
        else:
            placed[:, column - 11] += step
        return line_residuals(with_mount(CAMERA, turned), moved, seen, segments, placed)[0]

    _, jacobian = line_residuals(with_mount(CAMERA, mount), frames, seen, segments, shifts)
    for column in range(13):
        slopes = (residuals(column, 1e-6) - residuals(column, -1e-6)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, column], slopes, rtol=1e-4, atol=2e-3)
    # A sway is a mount that pitches or rolls in one frame.
    np.testing.assert_allclose(jacobian[:, :, 3:5], jacobian[:, :, MOUNT][:, :, 3:5])


def test_map_lines_move_at_right_angles(wire_map):
    segments = MapLines.of(wire_map)
    frame = np.concatenate([segments.across, segments.directions[:, None]], axis=1)
    np.testing.assert_allclose(
        frame @ frame.transpose(0, 2, 1), np.tile(np.eye(3), (len(wire_map), 1, 1)), atol=1e-12
    )


def test_a_look_from_nearby_finds_the_pose_and_its_pairs(wire_map):
    truth = POSES[0]
    seen = seen_from(wire_map, truth)
    ends = seen.rays[:, :, :2]
    way = ends[:, 1] - ends[:, 0]
    lengths = np.hypot(*way.T)
    tight = np.full(len(seen), 0.3)
    lines = LineMeasurements(
        seen.rays, tight, tight, ends, lengths, way / lengths[:, None], np.ones(len(seen))
    )
    near = Pose2(truth.x + 0.02, truth.y - 0.03, truth.phi + 0.01)
    found = look_again(Projector(CAMERA, wire_map), lines, near, RefinementConfig())
    assert found is not None
    best, again = found
    assert np.abs(best.belief.pose.minus(truth)).max() < 2e-3
    right = [row in again.rows for row in seen.rows]
    assert np.mean(right) > 0.8
    nowhere = Pose2(truth.x, truth.y, truth.phi + 2.5)
    assert look_again(Projector(CAMERA, wire_map), lines, nowhere, RefinementConfig()) is None
