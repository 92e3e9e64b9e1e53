"""Pictures of a toy building: a sharp one of an ideal camera, bent by the lens, then blur and noise."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from toy_building import Face

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.camera import Camera, CameraModel, CameraMount
from vision.images import GreyImage
from vision.lines import ImageSegments
from vision.projection import Prediction

MOUNT = CameraMount(x_m=0.1, height_m=1.2, pitch_down_rad=0.08)
CAMERA = Camera(CameraModel.PINHOLE_RADTAN, 640, 480, 540.0, 540.0, 322.0, 238.0, np.zeros(5), MOUNT)
BARREL = Camera(
    CameraModel.PINHOLE_RADTAN, 640, 480, 520.0, 523.0, 318.0, 243.0,
    np.array([-0.17, 0.03, 0.001, -0.0005, 0.0]), MOUNT,
)  # fmt: skip
FISHEYE = Camera(
    CameraModel.FISHEYE, 640, 480, 380.0, 381.0, 319.0, 241.0, np.array([0.02, -0.004, 0.001, 0.0]), MOUNT
)

#: Rays per pixel, in each direction.
_FINE = 2


def draw(
    faces: list[Face], camera: Camera, pose: Pose2, rng: np.random.Generator, clutter: int = 0
) -> GreyImage:
    """Return the picture (H, W) that the camera takes; `clutter` straight strokes that are in no map."""
    fine = _through_the_lens(faces, camera, pose)
    for _ in range(clutter):
        start, way = rng.uniform([0, 0], fine.shape[::-1]), rng.normal(0.0, 150.0, 2)
        ends = np.rint([start, start + way]).astype(int).tolist()
        cv2.line(fine, ends[0], ends[1], float(rng.integers(0, 256)), 2 * _FINE)
    image = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    noisy = image + rng.normal(0.0, 2.0, image.shape)
    grey: GreyImage = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return grey


def _through_the_lens(faces: list[Face], camera: Camera, pose: Pose2) -> cv2.typing.MatLike:
    """Return the grey levels in raw pixels, `_FINE` times finer."""
    step = 1.0 / (_FINE * camera.focal_px)
    u, v = (np.arange(_FINE * size) / _FINE - 0.5 + 0.5 / _FINE for size in (camera.width, camera.height))
    raw = np.stack(np.meshgrid(u, v), axis=2)
    wanted = camera.undistort(raw.reshape(-1, 2)).reshape(raw.shape)
    first, last = wanted.min(axis=(0, 1)), wanted.max(axis=(0, 1))
    x, y = (np.arange(first[axis], last[axis] + step, step) for axis in (0, 1))
    ideal = _trace(faces, *camera.map_from_optical(pose), x, y)
    places = ((wanted - first) / step).astype(np.float32)
    columns, rows = np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])
    return cv2.remap(ideal, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _trace(faces: list[Face], rotation: Array, centre: Array, x: Array, y: Array) -> Array:
    """Return the grey level along each ray (x, y, 1) of a grid: of the nearest face that it meets."""
    grey, nearest = np.zeros((len(y), len(x))), np.full((len(y), len(x)), 1e-6)
    for face in faces:
        corner, sides = (face.corner - centre) @ rotation, face.sides @ rotation
        normal = np.cross(sides[0], sides[1])
        ends = corner + np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) @ sides
        if ends[:, 2].max() <= 0.0 or abs(normal @ corner) < 1e-9:
            continue
        low, high = np.array([x[0], y[0]]), np.array([x[-1], y[-1]])
        if ends[:, 2].min() > 0.05:
            low, high = (pick(ends[:, :2] / ends[:, 2:], axis=0) for pick in (np.min, np.max))
        columns = slice(*np.searchsorted(x, [low[0], high[0]]))
        rows = slice(*np.searchsorted(y, [low[1], high[1]]))
        # 1 / depth along a ray is linear in (x, y), and so is each side's condition divided by the depth.
        inverse = normal / (normal @ corner)
        inner = [side - (side @ corner) * inverse for side in sides]
        outer = [(side @ side) * inverse - near for side, near in zip(sides, inner, strict=True)]
        closeness, *insides = (
            form[0] * x[columns] + (form[1] * y[rows] + form[2])[:, None]
            for form in (inverse, *inner, *outer)
        )
        met = closeness > nearest[rows, columns]
        for inside in insides:
            met &= inside >= 0.0
        grey[rows, columns][met] = face.grey
        nearest[rows, columns][met] = closeness[met]
    return grey


def exact_lines(camera: Camera, prediction: Prediction, sigma_px: float = 0.5) -> ImageSegments:
    """Return the predicted pieces as if they had been found in an image, without error."""
    raw = camera.distort(prediction.ideal_px.reshape(-1, 2) / camera.focal_px).reshape(-1, 2, 2)
    return segments_at(prediction.ideal_px, raw, sigma_px)


def segments_at(ideal: Array, raw: Array | None = None, sigma_px: float = 0.5) -> ImageSegments:
    """Return segments (M, 2, 2) as an extractor would; raw pixels, where nobody asks for them, the same."""
    one = np.ones(len(ideal))
    return ImageSegments(
        raw_px=ideal if raw is None else raw,
        ideal_px=ideal,
        sigma_px=sigma_px * one,
        sigma_middle_px=sigma_px / np.sqrt(2.0) * one,
        sigma_angle_rad=sigma_px
        * np.sqrt(2.0)
        / np.maximum(np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1), 1e-9),
        polarity=one,
        contrast=100.0 * one,
    )


def some_pieces(view: Prediction, keep: NDArray[Any]) -> Prediction:
    """Return some of the predicted pieces, by numbers or a mask."""
    return Prediction(*(getattr(view, column.name)[keep] for column in fields(Prediction)))


def poses_inside(wire_map: WireMap, rng: np.random.Generator, count: int) -> list[Pose2]:
    """Return random poses at least 0.4 m from every wall."""
    inner = wire_map.floor.buffer(-0.4)
    low, high = np.array(inner.bounds[:2]), np.array(inner.bounds[2:])
    drawn = rng.uniform([*low, -np.pi], [*high, np.pi], (20 * count, 3))
    return [Pose2.from_array(row) for row in drawn if shapely.contains_xy(inner, row[0], row[1])][:count]


def window_around(pose: Pose2, rng: np.random.Generator, dt_m: float, dphi_rad: float) -> SearchWindow:
    """Return a window of this size that holds the pose, with the pose anywhere inside."""
    away, bearing = dt_m * np.sqrt(rng.uniform(0.0, 1.0)), rng.uniform(-np.pi, np.pi)
    centre = Pose2(
        pose.x + away * np.cos(bearing),
        pose.y + away * np.sin(bearing),
        pose.phi + rng.uniform(-dphi_rad, dphi_rad),
    )
    return SearchWindow(centre, dt_m, dphi_rad)
