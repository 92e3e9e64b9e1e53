"""Drives: on the floor, within the robot's powers, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPolygon, Polygon

from maps.poses import Array, Pose2
from runs.simulation.freefloor import FreeFloor, NoRoomError
from runs.simulation.manoeuvres import Motion, move, turn
from runs.simulation.paths import TRUTH_HZ, Drive, DriveKind, simulate_drive

#: Two rooms with a door of 0.9 m between them, a pillar in one.
ROOMS = MultiPolygon(
    [
        Polygon(
            [
                (0, 0),
                (5, 0),
                (5, 1),
                (5.2, 1),
                (5.2, 0),
                (9, 0),
                (9, 4),
                (5.2, 4),
                (5.2, 1.9),
                (5, 1.9),
                (5, 4),
                (0, 4),
            ],
            [[(2, 2), (2.5, 2), (2.5, 2.5), (2, 2.5)]],
        )
    ]
)
RADIUS_M = 0.25


@pytest.fixture(scope="module")
def floor() -> FreeFloor:
    return FreeFloor.of(ROOMS, RADIUS_M, np.array([[5.1, 1.45]]))


def rates(drive: Drive) -> tuple[Array, Array]:
    forward, turned = drive.steps()
    return forward * TRUTH_HZ, turned * TRUTH_HZ


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_stays_clear_of_walls_and_within_its_powers(floor: FreeFloor, seed: int) -> None:
    motion = Motion()
    drive = simulate_drive(np.random.default_rng(seed), 60.0, floor=floor, motion=motion)
    places = shapely.points(drive.poses[:, :2])
    assert shapely.distance(ROOMS.boundary, places).min() > RADIUS_M - 1e-6
    assert shapely.contains(ROOMS, places).all()
    speed, rate = rates(drive)
    assert speed.min() > -1e-6
    assert 0.9 * motion.speed_mps < speed.max() < motion.speed_mps + 1e-6
    assert np.abs(rate).max() < motion.turn_radps + 1e-3
    assert np.abs(np.diff(speed)).max() * TRUTH_HZ < 1.02 * motion.acceleration_mps2
    assert np.abs(np.diff(rate)).max() * TRUTH_HZ < 1.05 * motion.turn_acceleration_radps2
    assert len(drive.stamps_ns) == 60 * TRUTH_HZ + 1


def test_drives_go_through_doors_and_turn_both_ways(floor: FreeFloor) -> None:
    drives = [simulate_drive(np.random.default_rng(seed), 60.0, floor=floor) for seed in range(4)]
    crossings = [np.count_nonzero(np.diff(drive.poses[:, 0] > 5.1)) for drive in drives]
    turned = np.concatenate([drive.steps()[1] for drive in drives])
    assert sum(crossings) >= 4
    assert turned[turned > 0.0].sum() > np.pi
    assert -turned[turned < 0.0].sum() > np.pi


def test_the_seed_decides(floor: FreeFloor) -> None:
    one, same, other = (simulate_drive(np.random.default_rng(seed), 20.0, floor=floor) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.poses, same.poses)
    assert np.abs(one.poses - other.poses).max() > 0.5


def test_named_drives_do_what_they_are_called() -> None:
    def drive(kind: DriveKind) -> Drive:
        return simulate_drive(np.random.default_rng(3), 40.0, kind)

    standing, turning, straight = (
        drive(kind) for kind in (DriveKind.STANDING, DriveKind.TURNING, DriveKind.STRAIGHT)
    )
    assert np.ptp(standing.poses, axis=0).max() == 0.0
    assert np.ptp(turning.poses[:, :2], axis=0).max() < 1e-12
    left = turning.steps()[1]
    assert left.max() > 0.01
    assert left.min() < -0.01
    assert straight.length_m > 10.0
    assert np.ptp(np.unwrap(straight.poses[:, 2])) < 1e-9
    assert drive(DriveKind.MIXED).length_m > 5.0


def test_a_robot_that_is_too_wide_is_refused() -> None:
    with pytest.raises(NoRoomError, match="no room"):
        FreeFloor.of(ROOMS, 2.5)


def test_a_robot_too_wide_for_the_door_stays_in_one_room() -> None:
    floor = FreeFloor.of(ROOMS, 0.5)
    drive = simulate_drive(np.random.default_rng(0), 60.0, floor=floor)
    assert np.count_nonzero(np.diff(drive.poses[:, 0] > 5.1)) == 0


def test_a_blended_corner_keeps_headings_along_the_way() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [4.0, 3.0]])
    bend = move(points, np.array([0.7, 0.6]), Motion())
    poses = bend.at(np.linspace(0.0, bend.duration_s, 200))
    steps = np.diff(poses[:, :2], axis=0)
    moving = np.hypot(*steps.T) > 1e-6
    heading = np.arctan2(steps[moving, 1], steps[moving, 0])
    middle = 0.5 * (poses[1:, 2] + poses[:-1, 2])[moving]
    assert np.abs(heading - middle).max() < 5e-3
    np.testing.assert_allclose(poses[-1, :2], points[-1], atol=1e-9)
    assert poses[:, 0].max() < 4.0 + 1e-9


def test_a_turn_ends_where_it_should() -> None:
    spin = turn(Pose2(1.0, 2.0, 3.0), -4.0, Motion())
    assert spin.end.phi == pytest.approx(-1.0)
    assert spin.duration_s > 4.0 / Motion().turn_radps


def test_poses_between_the_truths_stamps(floor: FreeFloor) -> None:
    drive = simulate_drive(np.random.default_rng(5), 10.0, floor=floor)
    halfway = (drive.stamps_ns[1:] + drive.stamps_ns[:-1]) // 2
    poses = drive.at(halfway)
    np.testing.assert_allclose(poses[:, :2], 0.5 * (drive.poses[1:, :2] + drive.poses[:-1, :2]), atol=1e-9)
    assert (np.abs(poses[:, 2]) <= np.pi).all()
