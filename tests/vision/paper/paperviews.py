"""Random views of single edges: where the camera stands, an edge that it sees, and the edge's noisy image."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from drawing import segments_at
from scipy.spatial.transform import Rotation
from shapely.geometry import MultiPolygon

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.camera import Camera, CameraModel, CameraMount
from vision.constraints import level_from_optical
from vision.lines import ImageSegments
from vision.paper.selection import ViewedDisc, viewed_disc

MOUNT = CameraMount(
    x_m=0.1, height_m=1.2, pitch_down_rad=0.1, yaw_rad=0.2, roll_rad=-0.05, std_yaw_rad=0.0, std_height_m=0.0
)
#: The paper's camera with its noise, on a crooked mount.
CAMERA = Camera(
    CameraModel.PINHOLE_RADTAN, 640, 480, 1000.0, 1000.0, 320.0, 240.0, np.zeros(5), MOUNT, 0.02, 2.0
)
STD_ANGLE, STD_OFFSET_PX, SIGMA_M = math.radians(1.0), 3.0, 0.01
WINDOW = SearchWindow(Pose2(2.0, 1.0, 0.7), 0.5, math.radians(15.0))
POINT = SearchWindow(WINDOW.centre, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """N images of `each` edges: all lie in one map, row k is image line k; image i has lines i each, ...

    `cameras`: (N, 3) true psi, x, y. `disc`: the window as the camera's.
    """

    wire_map: WireMap
    segments: ImageSegments
    cameras: Array
    disc: ViewedDisc

    @property
    def rows(self) -> Array:
        return np.arange(len(self.wire_map))


def bare_map(endpoints: Array, sigma_m: float = SIGMA_M) -> WireMap:
    """Return a map of edges alone, without floor or walls."""
    count, none = len(endpoints), np.zeros((0, 2, 2))
    return WireMap(
        endpoints=endpoints,
        names=tuple(map(str, range(count))),
        kinds=("edge",) * count,
        sigma_m=np.full(count, sigma_m),
        detection_rate=np.full(count, np.nan),
        polarity=np.zeros(count),
        floor=MultiPolygon(),
        sight_endpoints=endpoints,
        walls=none,
        wall_tops_m=np.zeros(0),
        lintels=none,
        lintel_bottoms_m=np.zeros(0),
    )


def views(
    rng: np.random.Generator,
    count: int,
    slope: str,
    *,
    noise: float = 0.0,
    window: SearchWindow = WINDOW,
    each: int = 1,
    principal: bool = True,
) -> Views:
    """Draw images of `each` edges, `slope` "level", "sloped" or "upright", from poses inside the window.

    `noise`: factor on table 1, on the errors of tilt and on the map's. `principal`: offset and direction err
    about the foot of the principal point, otherwise about a segment's middle.
    """
    disc = viewed_disc(CAMERA, window)
    away, bearing = window.dt_m * np.sqrt(rng.uniform(0, 1, count)), rng.uniform(-np.pi, np.pi, count)
    phi = window.centre.phi + rng.uniform(-1, 1, count) * window.dphi_rad
    psi = phi + MOUNT.yaw_rad
    cameras = np.column_stack(
        [
            psi,
            window.centre.x + away * np.cos(bearing) + MOUNT.x_m * np.cos(phi),
            window.centre.y + away * np.sin(bearing) + MOUNT.x_m * np.sin(phi),
        ]
    )
    level_ends = _edges(rng, count * each, slope)
    of = np.repeat(np.arange(count), each)
    cos, sin = np.cos(psi[of])[:, None], np.sin(psi[of])[:, None]
    x, y = level_ends[..., 0], level_ends[..., 1]
    plan = np.stack([cos * x - sin * y, sin * x + cos * y], axis=2) + cameras[of, None, 1:]
    endpoints = np.concatenate([plan, level_ends[..., 2:] + MOUNT.height_m], axis=2)
    ideal = _seen(rng, level_ends, of, noise)
    segments = _noisy(rng, ideal, noise, principal)
    told = endpoints + noise * SIGMA_M * rng.standard_normal(endpoints.shape)
    if slope == "upright":
        told[:, 1, :2] = told[:, 0, :2] = endpoints[:, 0, :2] + noise * SIGMA_M * rng.standard_normal(
            (len(told), 2)
        )
    return Views(bare_map(told, max(noise, 1e-6) * SIGMA_M), segments, cameras, disc)


def _edges(rng: np.random.Generator, count: int, slope: str) -> Array:
    """Edges (count, 2, 3) in the level frame of a camera that sees both their ends."""
    draws = 30 * count
    pixels = rng.uniform([-310.0, -230.0], [310.0, 230.0], (draws, 2))
    rays = np.column_stack([pixels, np.full(draws, CAMERA.focal_px)]) @ level_from_optical(CAMERA).T
    start = rays / rays[:, :1] * rng.uniform(1.5, 8.0, (draws, 1))
    way = rng.standard_normal((draws, 3))
    if slope == "level":
        way[:, 2] = 0.0
    elif slope == "upright":
        way[:, :2] = 0.0
    way /= np.linalg.norm(way, axis=1)[:, None]
    ends = np.stack([start, start + way * rng.uniform(0.5, 4.0, (draws, 1))], axis=1)
    optical = ends @ level_from_optical(CAMERA)
    inside = optical[..., 2].min(axis=1) > 0.5
    ideal = CAMERA.focal_px * optical[..., :2] / np.maximum(optical[..., 2:], 0.5)
    inside &= (np.abs(ideal) <= [320.0, 240.0]).all(axis=(1, 2))
    inside &= np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1) >= 60.0
    found = ends[inside]
    assert len(found) >= count
    return found[:count]


def _seen(rng: np.random.Generator, level_ends: Array, of: Array, noise: float) -> Array:
    """Ideal pixels of the edges by a camera that is not quite the one that is told; one draw an image."""
    images = of.max() + 1
    std = np.array([MOUNT.std_roll_rad, MOUNT.std_pitch_down_rad])
    roll, pitch = noise * std[:, None] * rng.standard_normal((2, images))
    axes = np.column_stack([roll * np.cos(0.1), pitch, -roll * np.sin(0.1)])
    turned = Rotation.from_rotvec(axes[of].repeat(2, axis=0)).inv().apply(level_ends.reshape(-1, 3))
    optical = turned.reshape(-1, 2, 3) @ level_from_optical(CAMERA)
    scale = CAMERA.focal_px * (1.0 + noise * CAMERA.std_focal * rng.standard_normal(images))
    centre = noise * CAMERA.std_centre_px * rng.standard_normal((images, 2))
    seen: Array = scale[of][:, None, None] * optical[..., :2] / optical[..., 2:] + centre[of][:, None]
    return seen


def _noisy(rng: np.random.Generator, ideal: Array, noise: float, principal: bool) -> ImageSegments:
    """The segments with errors of offset and direction, and what is said about them."""
    middle = ideal.mean(axis=1)
    along = (ideal[:, 1] - ideal[:, 0]) / np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1)[:, None]
    pivot = -(middle * along).sum(axis=1) if principal else np.zeros(len(ideal))
    turn = noise * STD_ANGLE * rng.standard_normal(len(ideal))
    across = np.column_stack([-along[:, 1], along[:, 0]])
    place = middle + pivot[:, None] * along
    place = place + (noise * STD_OFFSET_PX * rng.standard_normal(len(ideal)))[:, None] * across
    along = np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * across
    half = 0.5 * np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1)
    ends = place[:, None] + np.stack([-half - pivot, half - pivot], axis=1)[..., None] * along[:, None]
    one = np.full(len(ends), max(noise, 1e-6))
    return replace(
        segments_at(ends),
        sigma_middle_px=one * STD_OFFSET_PX,
        sigma_angle_rad=one * STD_ANGLE,
        pivot_px=pivot,
    )


def exact_camera() -> Camera:
    """Return the camera as one that is known exactly."""
    return replace(
        CAMERA,
        std_focal=0.0,
        std_centre_px=0.0,
        mount=replace(MOUNT, std_pitch_down_rad=0.0, std_roll_rad=0.0),
    )
