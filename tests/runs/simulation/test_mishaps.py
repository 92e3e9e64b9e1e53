"""What goes wrong on simulated drives: cameras turned by what was asked, wheels that roll more or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from localization.odometry import WheelGeometry
from maps.poses import Pose2
from runs.simulation.mishaps import Block, Bump, Flicker, Mishaps, Slip
from runs.simulation.paths import Drive, DriveKind, simulate_drive
from runs.simulation.wheels import EXACT_TWISTS, EXACT_WHEELS, simulate_encoders, simulate_twists
from vision.camera import Camera, CameraModel, CameraMount

S = 10**9
WHEELS = WheelGeometry(0.05, 0.05, 0.4)
CAMERA = Camera(
    CameraModel.PINHOLE_RADTAN,
    64,
    48,
    50.0,
    50.0,
    31.5,
    23.5,
    np.zeros(5),
    CameraMount(0.2, 0.1, 1.0, 0.3, 0.2, -0.1),
)


@pytest.fixture(scope="module")
def straight() -> Drive:
    return simulate_drive(np.random.default_rng(2), 10.0, DriveKind.STRAIGHT)


@pytest.mark.parametrize("turn", [(0.02, 0.0, 0.0), (0.0, 0.02, 0.0), (0.01, -0.03, 0.02)])
def test_a_bumped_camera_is_turned_in_its_own_frame_while_it_lasts(turn: tuple[float, float, float]) -> None:
    mishaps = Mishaps(bumps=(Bump(2 * S, 5 * S, turn),))
    assert mishaps.camera_at(CAMERA, 2 * S - 1) is CAMERA
    assert mishaps.camera_at(CAMERA, 5 * S) is CAMERA
    pose = Pose2(1.0, 2.0, 0.7)
    before, place = CAMERA.map_from_optical(pose)
    after, same = mishaps.camera_at(CAMERA, 2 * S).map_from_optical(pose)
    np.testing.assert_allclose(after, before @ Rotation.from_rotvec(turn).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(same, place)


def test_nothing_wrong_is_the_drive_itself() -> None:
    drive = simulate_drive(np.random.default_rng(3), 20.0)
    for told, was in zip(Mishaps().steps(drive, 0.4), drive.steps(), strict=True):
        np.testing.assert_array_equal(told, was)


def test_a_slip_rolls_both_wheels_on_and_no_farther_than_it_says(straight: Drive) -> None:
    mishaps = Mishaps(slips=(Slip(3 * S, 4 * S, 0.5),))
    exact = simulate_encoders(straight, WHEELS, WHEELS, EXACT_WHEELS, np.random.default_rng())
    slipped = simulate_encoders(straight, WHEELS, WHEELS, EXACT_WHEELS, np.random.default_rng(), mishaps)
    more_m = 0.05 * (slipped.values - exact.values)
    at = np.searchsorted(straight.stamps_ns, [3 * S, 3 * S + S // 2, 4 * S])
    np.testing.assert_allclose(more_m[at], [[0.0, 0.0], [0.25, 0.25], [0.5, 0.5]], atol=1e-9)
    np.testing.assert_allclose(more_m[-1], 0.5)


@pytest.mark.parametrize("side", [0, 1])
def test_a_blocked_wheel_stands_and_the_other_turns_on(straight: Drive, side: int) -> None:
    mishaps = Mishaps(blocks=(Block(2 * S, 4 * S, side),))
    encoders = simulate_encoders(straight, WHEELS, WHEELS, EXACT_WHEELS, np.random.default_rng(), mishaps)
    inside = (encoders.stamps_ns >= 2 * S) & (encoders.stamps_ns <= 4 * S)
    rolled_m = 0.05 * np.ptp(encoders.values[inside], axis=0)
    assert rolled_m[side] == 0.0
    assert rolled_m[1 - side] > 0.1
    # Twists are those of the same wheels: half of the way, and a turn to the side that stands.
    twists = simulate_twists(straight, EXACT_TWISTS, np.random.default_rng(), mishaps, 0.4)
    forward, turn = twists.values[:-1][inside[:-1] & (twists.stamps_ns[:-1] < 4 * S)].sum(axis=0) / 50.0
    assert forward == pytest.approx(0.5 * rolled_m[1 - side])
    assert turn == pytest.approx((1.0 if side == 0 else -1.0) * rolled_m[1 - side] / 0.4)


def test_lamps_flicker_within_their_stops_and_their_time() -> None:
    mishaps = Mishaps(flickers=(Flicker(2 * S, 5 * S, 0.3, 3.0),))
    np.testing.assert_array_equal(mishaps.exposure_at(S, 1, 48), np.ones(48))
    stops = np.log2([mishaps.exposure_at(3 * S, number, 480) for number in (3, 4)])
    assert stops.max() == pytest.approx(1.5, abs=0.01)
    assert stops.min() == pytest.approx(-1.5, abs=0.01)
    assert np.abs(stops[0] - stops[1]).max() > 0.5
