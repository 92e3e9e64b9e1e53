"""Where a robot's camera sits, by the transforms of its bag, and what its CameraInfo says of the lens."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from maps.errors import InputError
from maps.poses import Array
from runs.camerainfo import camera_of_info
from vision.camera import BASE_FROM_OPTICAL, Camera, CameraMount, mount_of

#: What robots call the frame between their wheels, the one on the floor first.
BASES = ("base_footprint", "base_link", "base", "chassis")


#: Beyond any place of a frame; NaN is beyond it too.
_MOST = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    parent: str
    rotation: Array
    translation: Array


@dataclass(slots=True)
class FrameTree:
    """The transforms of a bag that do not change: each frame's parent, and where it sits there."""

    edges: dict[str, _Edge] = field(default_factory=dict)
    moving: set[str] = field(default_factory=set)

    def take(self, message: Any) -> None:
        """Add the transforms of a TFMessage; a frame that moves is remembered as such."""
        for told in message.transforms:
            turn, shift = told.transform.rotation, told.transform.translation
            child, parent = told.child_frame_id.lstrip("/"), told.header.frame_id.lstrip("/")
            values = np.array([turn.x, turn.y, turn.z, turn.w, shift.x, shift.y, shift.z])
            if not (np.abs(values) < _MOST).all():
                # Nobody can say where that is; nobody may ask.
                self.moving.add(child)
                continue
            rotation = rotation_of((turn.x, turn.y, turn.z, turn.w))
            edge = _Edge(parent, rotation, np.array([shift.x, shift.y, shift.z]))
            known = self.edges.setdefault(child, edge)
            same = known.parent == parent and np.allclose(known.translation, edge.translation, atol=1e-6)
            if not (same and np.allclose(known.rotation, rotation, atol=1e-6)):
                self.moving.add(child)

    def mount(self, path: Path, frame: str, base: str) -> CameraMount:
        """Return the mount of a camera by the frame of its images; `base`: what odometry calls the robot's frame.

        The frame between the wheels is `base`, or one of `BASES`; its height above the floor is that of
        `base_footprint` where there is one above it, else nothing. InputError where no fixed way leads there,
        or where the frame cannot be a camera's.
        """
        frame, base = frame.lstrip("/"), base.lstrip("/")
        way = self._way(frame)
        bases = [name for name in (base, *BASES) if name in way]
        if not bases:
            told = " < ".join(way) or "none"
            raise InputError(
                path,
                "tf_static",
                f"no transform from {base or BASES[1]} to {frame!r} ({told}): name the mount with --robot",
            )
        rotation, place = self._from(frame, bases[0])
        _, floor = self._from(frame, BASES[0]) if BASES[0] in way else (rotation, place)
        try:
            return mount_of(rotation @ BASE_FROM_OPTICAL.T, np.array([place[0], place[1], floor[2]]))
        except ValueError as error:
            raise InputError(path, "tf_static", f"{frame!r} {error}") from None

    def _way(self, frame: str) -> list[str]:
        """Return the frames from one upwards, as far as nothing moves."""
        way = [frame]
        while way[-1] in self.edges and way[-1] not in self.moving:
            parent = self.edges[way[-1]].parent
            if parent in way:
                break
            way.append(parent)
        return way

    def _from(self, frame: str, base: str) -> tuple[Array, Array]:
        """Return the rotation (3, 3) and the place (3,) of a frame in one above it."""
        rotation, place = np.eye(3), np.zeros(3)
        while frame != base:
            edge = self.edges[frame]
            rotation, place = edge.rotation @ rotation, edge.rotation @ place + edge.translation
            frame = edge.parent
        return rotation, place


def camera_of_message(path: Path, topic: str, message: Any, rectified: bool) -> Camera:
    """Return the camera of a CameraInfo message, its mount left open; that of rectified images has no distortion.

    InputError names the topic and what does not fit: a lens without a model here, a picture binned or cut out.
    """
    # ROS 1 writes the matrices with capital letters.
    matrix, distortion, projection = (
        np.array(
            getattr(message, name, None) if hasattr(message, name) else getattr(message, name.upper()), float
        )
        for name in "kdp"
    )
    region = message.roi
    cut = bool(region.width) and (region.width, region.height) != (message.width, message.height)
    if max(message.binning_x, message.binning_y) > 1 or cut:
        raise InputError(
            path, topic, "the images are binned or cut out of larger ones, which is not supported"
        )
    model = message.distortion_model or "plumb_bob"
    if rectified:
        matrix, distortion, model = projection.reshape(3, 4)[:, :3].ravel(), np.zeros(5), "plumb_bob"
    if not np.isfinite(matrix).all() or not np.isfinite(distortion).all():
        raise InputError(path, topic, "numbers that are not finite")
    named = Path(f"{path}: {topic}")
    camera = camera_of_info(
        named, (int(message.width), int(message.height)), model, matrix.tolist(), distortion.tolist()
    )
    if not camera.width or not camera.height:
        raise InputError(path, topic, "images of no size")
    return camera


def mounted(camera: Camera, mount: CameraMount) -> Camera:
    """Return the camera, mounted."""
    return replace(camera, mount=mount)


def rotation_of(quaternion: tuple[float, float, float, float]) -> Array:
    """Return the rotation (3, 3) of a quaternion x, y, z, w; one of no length turns nothing."""
    x, y, z, w = np.array(quaternion) / (np.linalg.norm(quaternion) or 1.0)
    if not (x or y or z or w):
        return np.eye(3)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
