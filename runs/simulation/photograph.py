"""A camera's picture of a scene: rays through its lens, then what its optics and its sensor add."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from maps.poses import Array
from runs.simulation.casting import cast_picture
from runs.simulation.scene import Scene
from vision.camera import Camera

GreyImage = NDArray[np.uint8]

#: The eye, or an automatic exposure, brings the median of a picture to this share of full scale.
_GREY = 0.14
_GAMMA = 1.0 / 2.2


@dataclass(frozen=True, slots=True)
class Sensor:
    """What stands between a scene and its picture.

    `rays`: a pixel. `blur_px`: of the optics, sigma. `vignetting`: light lost in the corners, a share.
    `full_well`: electrons of a white pixel, whose square root is the noise; `read_electrons`: further noise.
    `exposure_s`: how long it looks; motion blurs. `quality`: of the JPEG.
    """

    rays: int = 5
    blur_px: float = 0.7
    vignetting: float = 0.25
    full_well: float = 2500.0
    read_electrons: float = 12.0
    exposure_s: float = 0.015
    quality: int = 90


#: A sensor that adds nothing to its pixels.
IDEAL = Sensor(rays=16, blur_px=0.0, vignetting=0.0, full_well=1e12, read_electrons=0.0, exposure_s=0.0)


class Photographer:
    """Takes pictures of one scene with one camera, as it truly is."""

    def __init__(self, scene: Scene, camera: Camera, sensor: Sensor) -> None:
        self._scene, self._camera, self._sensor = scene, camera, sensor
        self._rays = pixel_corners(camera)
        self._falloff = _falloff(camera, sensor.vignetting)

    def take(
        self, rotations: Array, centres: Array, rng: np.random.Generator, exposure: Array | None = None
    ) -> GreyImage:
        """Return a picture, (H, W) grey; map_from_optical at moments of the exposure, (S, 3, 3) and (S, 3).

        `exposure`: (H,) what each row's light is multiplied with, beside what the camera sets; ones without it.
        """
        sensor, scene = self._sensor, self._scene
        moments = np.ascontiguousarray(rotations), np.ascontiguousarray(centres)
        radiance = cast_picture(self._rays, *moments, scene.mesh, scene.lights, int(rng.integers(2**31)))
        if sensor.blur_px > 0.0:
            radiance = gaussian_filter(radiance, sensor.blur_px, mode="nearest")
        exposed = radiance * self._falloff
        exposed = exposed * (_GREY / max(float(np.median(exposed)), 1e-6))
        if exposure is not None:
            exposed = exposed * exposure[:, None]
        # In the dark the exposure cannot go on for ever: a white pixel then has fewer electrons.
        well = sensor.full_well * min(1.0, scene.brightness)
        electrons = well * np.minimum(exposed, 4.0)
        noise = np.sqrt(electrons + sensor.read_electrons**2)
        electrons = electrons + noise * rng.standard_normal(electrons.shape)
        share = np.clip(electrons / well, 0.0, 1.0)
        return np.round(255.0 * share**_GAMMA).astype(np.uint8)


def pixel_corners(camera: Camera) -> Array:
    """Return the normalised image coordinates of the corners of pixels, (H + 1, W + 1, 2)."""
    columns, rows = np.arange(camera.width + 1) - 0.5, np.arange(camera.height + 1) - 0.5
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    return np.ascontiguousarray(camera.undistort(grid.reshape(-1, 2)).reshape(*grid.shape))


def _falloff(camera: Camera, vignetting: float) -> Array:
    """Return how much light reaches each pixel, (H, W)."""
    y, x = np.mgrid[: camera.height, : camera.width]
    away = np.hypot(x - camera.cx, y - camera.cy) / np.hypot(0.5 * camera.width, 0.5 * camera.height)
    result: Array = 1.0 - vignetting * away**2
    return result
