"""Odometry of bags: twists out of poses, wheels out of joints."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from localization.odometry import OdometryNoise, advance
from maps.errors import InputError
from maps.poses import Pose2
from runs.bags.wheels import WheelRows, held_twists
from runs.session import Odometry


def drive(values, stamps_ns):
    """Return the poses of a robot that keeps each twist until the next row, (N, 3)."""
    pose = Pose2(3.0, -2.0, 3.0)
    poses = [pose]
    for _, step in Odometry(stamps_ns, stamps_ns, values, None).steps(OdometryNoise()):
        poses.append(pose := advance(pose, step))
    return np.array([pose.as_array() for pose in poses])


def joints(names, positions):
    return SimpleNamespace(name=names, position=np.array(positions))


def test_twists_out_of_poses():
    rng = np.random.default_rng(1)
    stamps_ns = np.cumsum(rng.integers(10**7, 5 * 10**7, 200))
    values = rng.uniform((-0.5, -2.0), (1.0, 2.0), (200, 2))
    found, jumps = held_twists(stamps_ns, drive(values, stamps_ns), np.zeros((200, 2)))
    assert jumps == 0
    np.testing.assert_allclose(found[:-1], values[:-1], atol=1e-9)


def test_a_pose_set_anew_is_not_driven():
    stamps_ns = np.arange(1, 101) * 20_000_000
    values = np.tile([0.4, 0.1], (100, 1))
    poses = drive(values, stamps_ns)
    poses[50:, 0] += 7.0
    found, jumps = held_twists(stamps_ns, poses, values)
    assert jumps == 1
    np.testing.assert_allclose(found, values, atol=1e-9)


def test_poses_that_never_change_are_not_believed():
    stamps_ns, values = np.arange(1, 11) * 10**8, np.tile([0.4, 0.1], (10, 1))
    assert (held_twists(stamps_ns, np.zeros((10, 3)), values)[0] == values).all()


@pytest.mark.parametrize(
    "names",
    [
        ("left_wheel_joint", "right_wheel_joint"),
        ("wheel_left_joint", "wheel_right_joint"),
        ("wheel_l_j", "wheel_r_j"),
    ],
)
def test_wheels_are_guessed_by_their_names(tmp_path, names):
    rows = WheelRows(tmp_path, "/joints")
    assert rows.take(joints(["arm_left_joint", names[1], names[0]], [9.0, 2.0, 1.0]))
    assert not rows.take(joints(["arm_left_joint"], [9.0]))
    assert rows.rows().tolist() == [[1.0, 2.0]]


def test_more_wheels_must_be_named(tmp_path):
    names = ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"]
    with pytest.raises(InputError, match="--joints: front_left_wheel, front_right_wheel"):
        WheelRows(tmp_path, "/joints").take(joints(names, [0.0] * 4))
    named = WheelRows(tmp_path, "/joints", ("rear_left_wheel", "rear_right_wheel"))
    named.take(joints(names, [1.0, 2.0, 3.0, 4.0]))
    assert named.rows().tolist() == [[3.0, 4.0]]


def test_angles_within_a_turn_are_unrolled(tmp_path):
    rows = WheelRows(tmp_path, "/joints", ("l", "r"))
    angles = np.column_stack([np.arange(40) * 0.5, np.arange(40) * -0.3])
    for row in angles:
        rows.take(joints(["l", "r"], np.angle(np.exp(1j * row))))
    np.testing.assert_allclose(rows.rows(), angles, atol=1e-9)


def test_joints_without_positions(tmp_path):
    with pytest.raises(InputError, match="no positions"):
        WheelRows(tmp_path, "/joints", ("l", "r")).take(joints(["l", "r"], []))
