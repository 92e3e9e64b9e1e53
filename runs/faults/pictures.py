"""What goes wrong with pictures: too dark, too bright, blurred, half covered, uneven, or of a bumped camera."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from maps.poses import Array
from runs.faults.recording import Edit, Recording, Span
from runs.simulation.mishaps import band_exposure
from vision.camera import Camera
from vision.images import GreyImage

#: Blur, as a share of the picture's width: 6 pixels of 640. Edges of a hall run into each other.
BLUR_SHARE = 0.01
#: Exposure of neighbouring bands differs by so many stops at most.
STOPS = 3.0
BUMP_RAD = math.radians(1.0)


def blackout(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Leave nothing but the sensor's own noise around black."""
    return recording.with_edits(span, _levels(6.0, 2.0, rng))


def whiteout(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Leave nothing but the sensor's own noise around white."""
    return recording.with_edits(span, _levels(253.0, 2.0, rng))


def blur(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Take pictures out of focus."""

    def edit(image: GreyImage) -> GreyImage:
        return _grey(gaussian_filter(image.astype(np.float64), BLUR_SHARE * image.shape[1], mode="nearest"))

    return recording.with_edits(span, lambda _: edit)


def occluder(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Put something in front of one half of the picture, its rim a little out of focus."""
    side, grey = int(rng.integers(4)), float(rng.uniform(20.0, 120.0))

    def edit(image: GreyImage) -> GreyImage:
        height, width = image.shape
        cover = np.zeros((height, width))
        halves = (np.s_[:, : width // 2], np.s_[:, width // 2 :], np.s_[: height // 2], np.s_[height // 2 :])
        cover[halves[side]] = 1.0
        cover = gaussian_filter(cover, 3.0, mode="nearest")
        return _grey(image * (1.0 - cover) + grey * cover)

    return recording.with_edits(span, lambda _: edit)


def rolling_exposure(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let bands of too much and too little exposure roll over the pictures, as lamps that flicker do."""
    phase_rad = band_phase(rng)

    def at(number: int) -> Edit:
        def edit(image: GreyImage) -> GreyImage:
            exposure = band_exposure(number, image.shape[0], phase_rad, STOPS)
            # Light adds up before the camera's gamma.
            return _grey(255.0 * ((image / 255.0) ** 2.2 * exposure[:, None]) ** (1.0 / 2.2))

        return edit

    return recording.with_edits(span, at)


def bumped(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Turn the camera on its mount by one degree about an axis that the seed chooses."""
    camera = recording.session.camera
    if camera is None:
        return recording
    places = _turned(camera, bump_turn(rng))

    def edit(image: GreyImage) -> GreyImage:
        return _grey(map_coordinates(image.astype(np.float64), places, order=1, mode="nearest"))

    return recording.with_edits(span, lambda _: edit)


def band_phase(rng: np.random.Generator) -> float:
    """Draw where the bands of exposure are in a session's first frame."""
    return float(rng.uniform(0.0, math.tau))


def bump_turn(rng: np.random.Generator) -> Array:
    """Draw how a bump turns a camera: a rotation vector (3,) in its optical frame."""
    axis = rng.standard_normal(3)
    result: Array = BUMP_RAD * axis / np.linalg.norm(axis)
    return result


def _levels(mean: float, noise: float, rng: np.random.Generator) -> Callable[[int], Edit]:
    seed = int(rng.integers(2**31))

    def at(number: int) -> Edit:
        def edit(image: GreyImage) -> GreyImage:
            # Each frame has its own numbers, whatever order pictures are written in.
            drawn = np.random.default_rng((seed, number)).standard_normal(image.shape)
            return _grey(mean + noise * drawn)

        return edit

    return at


def _turned(camera: Camera, turn_rad: Array) -> Array:
    """Return where a camera that is turned finds its pixels in the old picture: (2, H, W) row, column.

    `turn_rad`: (3,) rotation vector in the optical frame.
    """
    rows, columns = np.mgrid[: camera.height, : camera.width]
    flat = camera.undistort(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64))
    rays = np.column_stack([flat, np.ones(len(flat))]) @ Rotation.from_rotvec(turn_rad).as_matrix().T
    found_px = camera.distort(rays[:, :2] / rays[:, 2:])
    result: Array = found_px[:, ::-1].T.reshape(2, camera.height, camera.width)
    return result


def _grey(values: Array) -> GreyImage:
    return np.round(np.clip(values, 0.0, 255.0)).astype(np.uint8)
