"""What goes wrong while a robot drives: its camera bumped, lamps that flicker, wheels that lose the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from maps.poses import Array
from runs.simulation.paths import Drive
from vision.camera import BASE_FROM_OPTICAL, Camera, CameraMount

#: Bands of light over the height of a picture, and how far they roll from one frame to the next.
_BANDS, _ROLL_RAD = 1.5, 0.7


@dataclass(frozen=True, slots=True)
class Bump:
    """The camera turned on its mount: `turn_rad`, a rotation vector in the optical frame as it was before."""

    start_ns: int
    end_ns: int
    turn_rad: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Flicker:
    """Lamps that flicker under a shutter that reads row by row: bands of exposure, `stops` apart at most."""

    start_ns: int
    end_ns: int
    phase_rad: float
    stops: float


@dataclass(frozen=True, slots=True)
class Slip:
    """Both wheels roll `extra_m` more than the robot drives, evenly."""

    start_ns: int
    end_ns: int
    extra_m: float


@dataclass(frozen=True, slots=True)
class Block:
    """One wheel, 0 the left and 1 the right one, drags over the floor without turning."""

    start_ns: int
    end_ns: int
    side: int


@dataclass(frozen=True, slots=True)
class Mishaps:
    """All that goes wrong on one drive; each from its start on, up to its end."""

    bumps: tuple[Bump, ...] = ()
    flickers: tuple[Flicker, ...] = ()
    slips: tuple[Slip, ...] = ()
    blocks: tuple[Block, ...] = ()

    def camera_at(self, camera: Camera, stamp_ns: int) -> Camera:
        """Return a camera as it sits on its robot at a stamp."""
        for bump in self.bumps:
            if bump.start_ns <= stamp_ns < bump.end_ns:
                camera = replace(camera, mount=turned_mount(camera.mount, np.array(bump.turn_rad)))
        return camera

    def exposure_at(self, stamp_ns: int, number: int, height: int) -> Array:
        """Return what the light of each row, (height,), is multiplied with in the frame of that number."""
        exposure = np.ones(height)
        for flicker in self.flickers:
            if flicker.start_ns <= stamp_ns < flicker.end_ns:
                exposure *= band_exposure(number, height, flicker.phase_rad, flicker.stops)
        return exposure

    def steps(self, drive: Drive, baseline_m: float) -> tuple[Array, Array]:
        """Return the way [m] and the turn [rad] of each step of a drive as the wheels roll it, (N - 1,) each."""
        forward, turned = drive.steps()
        if not (self.slips or self.blocks):
            return forward, turned
        half = 0.5 * baseline_m * turned
        rolled = np.column_stack([forward - half, forward + half])
        starts_ns, ends_ns = drive.stamps_ns[:-1], drive.stamps_ns[1:]
        for slip in self.slips:
            done = np.clip((drive.stamps_ns - slip.start_ns) / max(slip.end_ns - slip.start_ns, 1), 0.0, 1.0)
            rolled += slip.extra_m * np.diff(done)[:, None]
        for block in self.blocks:
            rolled[(starts_ns < block.end_ns) & (ends_ns > block.start_ns), block.side] = 0.0
        return rolled.mean(axis=1), (rolled[:, 1] - rolled[:, 0]) / baseline_m


def band_exposure(number: int, height: int, phase_rad: float, stops: float) -> Array:
    """Return the factors of rows (height,) in the frame of that number: bands that roll on from frame to frame."""
    rows = np.arange(height) / height
    phase = phase_rad + _ROLL_RAD * number
    result: Array = 2.0 ** (0.5 * stops * np.sin(_BANDS * math.tau * rows + phase))
    return result


def turned_mount(mount: CameraMount, turn_rad: Array) -> CameraMount:
    """Return the mount of a camera that is turned where it sits, by a rotation vector (3,) in its optical frame."""
    before = Rotation.from_euler("ZYX", [mount.yaw_rad, mount.pitch_down_rad, mount.roll_rad])
    turn = Rotation.from_matrix(
        BASE_FROM_OPTICAL @ Rotation.from_rotvec(turn_rad).as_matrix() @ BASE_FROM_OPTICAL.T
    )
    yaw, pitch, roll = (before * turn).as_euler("ZYX").tolist()
    return replace(mount, yaw_rad=yaw, pitch_down_rad=pitch, roll_rad=roll)
