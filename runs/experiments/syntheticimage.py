"""Synthetic images of a map: known pose, noisy segments with their sources, and an initial estimate.

Section 4.1 of the paper: random poses on the floor, the visible segments through the paper's camera, noise of
table 1, added lines that belong to nothing. What is drawn for one image hangs on the seed and the image's
number alone. Its scene is the same in all cases, and noise, added lines, estimate and faults are drawn apart:
cases that differ in one of them share the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from maps.errors import InputError
from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.experiments.cases import CASES, FEWEST, MOST, STD_CENTRE_PX, STD_SCALE, Case
from runs.experiments.linenoise import deviations, disturbed, image_segments, stated_noise
from vision.camera import Camera, CameraModel, CameraMount
from vision.lines import ImageSegments
from vision.pose import LineObservations, pose_bound
from vision.projection import Projector

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 1000.0
CENTRE_PX = (320.0, 240.0)
CAMERA_HEIGHT_M = 1.2
#: The paper's theta is 90 degrees plus this, up and down.
MOST_PITCH_RAD = math.radians(8.0)
#: How near to a wall a robot stands.
CLEARANCE_M = 0.5
#: Shorter segments are not extracted; added lines are at most this long.
MIN_LENGTH_PX, MAX_CLUTTER_PX = 40.0, 300.0
#: A broken segment loses this much between its fragments.
GAP_PX = 10.0
#: A map of which so many poses in a row show too little is not one for this experiment.
_MOST_DRAWS = 5000


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticImage:
    """One image.

    `camera`: as a method is told it. `truth`: the robot's pose. `sources`: (M,) the map row of each segment, -1
    for added lines. `bound`: (3, 3) Cramer-Rao bound on the covariance of (x, y, phi).
    """

    camera: Camera
    segments: ImageSegments
    window: SearchWindow
    truth: Pose2
    sources: NDArray[np.int64]
    bound: Array


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A pose with the camera's pitch, and what is to be seen from it.

    `rows`: (V,) of the map, `ends`: (V, 2, 2) exact segments, ideal pixels. `streams`: what the noise, the added
    lines, the estimate and the faults of this image are drawn from.
    """

    pose: Pose2
    pitch_rad: float
    rows: NDArray[np.int64]
    ends: Array
    streams: tuple[np.random.SeedSequence, ...]


def draw_scene(wire_map: WireMap, seed: int, number: int) -> Scene:
    """Draw poses until one shows enough; InputError where the map shows too little from everywhere."""
    drawn, *streams = np.random.SeedSequence(seed, spawn_key=(number,)).spawn(5)
    rng = np.random.default_rng(drawn)
    room = standing_room(wire_map)
    x0, y0, x1, y1 = room.bounds
    every = np.arange(len(wire_map))
    for _ in range(_MOST_DRAWS):
        x, y = rng.uniform([x0, y0], [x1, y1]).tolist()
        phi, pitch = rng.uniform(-math.pi, math.pi), rng.uniform(-MOST_PITCH_RAD, MOST_PITCH_RAD)
        if not shapely.contains_xy(room, x, y):
            continue
        pose = Pose2(x, y, phi)
        seen = Projector(paper_camera(pitch), wire_map).predict(pose, every)
        # An edge seen in several stretches counts once, with the longest.
        order = np.argsort(-seen.lengths_px, kind="stable")
        order = order[seen.lengths_px[order] >= MIN_LENGTH_PX]
        rows, first = np.unique(seen.rows[order], return_index=True)
        if len(rows) >= FEWEST:
            some = np.sort(rng.permutation(len(rows))[:MOST])
            return Scene(pose, pitch, rows[some], seen.ideal_px[order[first[some]]], tuple(streams))
    raise InputError("--hall", "segments", f"hardly any pose sees {FEWEST} edges of {MIN_LENGTH_PX:.0f} px")


def synthetic_image(wire_map: WireMap, scene: Scene, case: Case) -> SyntheticImage:
    """Draw a scene as a case wants it."""
    noise_rng, clutter_rng, estimate_rng, fault_rng = map(np.random.default_rng, scene.streams)
    told_pitch = scene.pitch_rad + case.std_tilt_rad * fault_rng.standard_normal()
    rows, exact = _extracted(scene, case, fault_rng)
    clutter = _clutter(case, clutter_rng)
    ends = np.concatenate([disturbed(exact, case, noise_rng), clutter])
    sources = np.concatenate([rows, np.full(len(clutter), -1)])
    # A method must not find the truth by the order of the lines.
    order = clutter_rng.permutation(len(ends))
    true_camera = paper_camera(scene.pitch_rad, case)
    return SyntheticImage(
        camera=paper_camera(told_pitch, case),
        segments=image_segments(ends[order], CENTRE_PX, case),
        window=_window(wire_map, scene.pose, case, estimate_rng),
        truth=scene.pose,
        sources=sources[order],
        bound=pose_bound(scene.pose, true_camera, observed(wire_map, true_camera, rows, exact, case)),
    )


def exactly_known(wire_map: WireMap) -> WireMap:
    """Return the map as one without errors: images are drawn from itself."""
    return replace(wire_map, sigma_m=np.full(len(wire_map), 1e-4))


def standing_room(wire_map: WireMap) -> shapely.Polygon | shapely.MultiPolygon:
    """Return where a robot may stand; InputError where that is nowhere."""
    room: shapely.Polygon | shapely.MultiPolygon = wire_map.floor.buffer(-CLEARANCE_M)
    if room.is_empty:
        raise InputError("--hall", "floor", f"nowhere {CLEARANCE_M} m away from the walls")
    return room


def paper_camera(pitch_down_rad: float, case: Case | None = None) -> Camera:
    """Return the paper's camera with what a case tells about it."""
    case = case or CASES["qi3"]
    factor = 0.0 if case.per_point else stated_noise(case)
    mount = CameraMount(
        height_m=CAMERA_HEIGHT_M,
        pitch_down_rad=pitch_down_rad,
        std_height_m=0.0,
        std_pitch_down_rad=case.std_tilt_rad,
        std_yaw_rad=0.0,
        std_roll_rad=0.0,
    )
    return Camera(
        model=CameraModel.PINHOLE_RADTAN,
        width=WIDTH,
        height=HEIGHT,
        fx=FOCAL_PX,
        fy=FOCAL_PX,
        cx=CENTRE_PX[0],
        cy=CENTRE_PX[1],
        distortion=np.zeros(5),
        mount=mount,
        std_focal=factor * STD_SCALE,
        std_centre_px=factor * STD_CENTRE_PX,
    )


def _extracted(scene: Scene, case: Case, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
    """What of a scene is extracted: without those missed, the long ones broken where the case says so."""
    missed = rng.random(len(scene.rows)) < case.missed
    rows, ends = scene.rows[~missed], scene.ends[~missed]
    if not case.fragments:
        return rows, ends
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    room = length - 2.0 * MIN_LENGTH_PX - GAP_PX
    cut = ((MIN_LENGTH_PX + rng.random(len(rows)) * np.maximum(room, 0.0)) / length)[:, None]
    gap = (GAP_PX / length)[:, None]
    start, span = ends[:, 0], ends[:, 1] - ends[:, 0]
    first = np.stack([start, start + cut * span], axis=1)
    second = np.stack([start + (cut + gap) * span, ends[:, 1]], axis=1)
    broken = room > 0.0
    pieces = [ends[~broken], first[broken], second[broken]]
    return np.concatenate([rows[~broken], rows[broken], rows[broken]]), np.concatenate(pieces)


def _clutter(case: Case, rng: np.random.Generator) -> Array:
    """Added lines (C, 2, 2), ideal pixels: uniform in place, direction and length, cut at the image's border."""
    count = case.clutter if case.clutter is not None else int(rng.integers(FEWEST, MOST + 1))
    low = -np.array(CENTRE_PX)
    high = low + [WIDTH - 1.0, HEIGHT - 1.0]
    found: list[Array] = []
    while len(found) < count:
        middle, angle = rng.uniform(low, high), rng.uniform(0.0, math.pi)
        half = 0.5 * rng.uniform(MIN_LENGTH_PX, MAX_CLUTTER_PX)
        along = np.array([math.cos(angle), math.sin(angle)])
        with np.errstate(divide="ignore"):
            borders = np.sort(np.stack([(low - middle) / along, (high - middle) / along]), axis=0)
        start, end = max(-half, borders[0].max()), min(half, borders[1].min())
        if end - start >= MIN_LENGTH_PX:
            found.append(middle + np.outer([start, end], along))
    return np.array(found).reshape(-1, 2, 2)


def _window(wire_map: WireMap, pose: Pose2, case: Case, rng: np.random.Generator) -> SearchWindow:
    """The initial estimate: uniform in disc and range about the truth; without one, the whole floor."""
    radius, bearing, turn = math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi), rng.uniform(-1.0, 1.0)
    if math.isinf(case.dt_m):
        return whole_floor(wire_map)
    shift = case.dt_m * radius
    centre = Pose2(
        pose.x + shift * math.cos(bearing),
        pose.y + shift * math.sin(bearing),
        pose.phi + turn * case.dphi_rad,
    )
    return SearchWindow(centre, case.dt_m, case.dphi_rad)


def whole_floor(wire_map: WireMap) -> SearchWindow:
    """Return the window of a robot that knows nothing: every place and heading."""
    x0, y0, x1, y1 = wire_map.floor.bounds
    return SearchWindow(
        Pose2(0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0), 0.5 * math.hypot(x1 - x0, y1 - y0), math.pi
    )


def observed(
    wire_map: WireMap, camera: Camera, rows: NDArray[np.int64], ends: Array, case: Case
) -> LineObservations:
    """Return drawn segments (K, 2, 2) paired with their edges, rows (K,) of the map, for an estimator."""
    known = deviations(ends, case)
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=1)
    pivot = ends.mean(axis=1) + (known.pivot_px / length)[:, None] * span
    points = np.stack([pivot - 0.5 * span, pivot + 0.5 * span], axis=1)
    edges = wire_map.endpoints[rows]
    direction = edges[:, 1] - edges[:, 0]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    return LineObservations(
        moments=np.cross(edges[:, 0], direction),
        directions=direction,
        rays=np.concatenate([points, np.full((len(rows), 2, 1), camera.focal_px)], axis=2),
        sigma_middle_px=known.offset_px,
        sigma_slope_px=0.5 * length * known.angle_rad,
    )
