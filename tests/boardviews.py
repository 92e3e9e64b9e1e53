"""Pictures of a calibration board as a camera with a known lens takes them, and the poses to take them from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from maps.poses import Array
from vision.boards import Board, Charuco, Corners
from vision.camera import Camera, CameraModel, CameraMount, rotation_x, rotation_y
from vision.images import GreyImage

#: Small pictures, so that many can be drawn.
BARREL = Camera(
    CameraModel.PINHOLE_RADTAN, 320, 240, 270.0, 269.0, 161.0, 119.0,
    np.array([-0.25, 0.08, 0.001, -0.0005, 0.0]), CameraMount(),
)  # fmt: skip
FISHEYE = Camera(
    CameraModel.FISHEYE, 320, 240, 125.0, 125.5, 159.0, 120.5,
    np.array([0.02, -0.004, 0.001, 0.0]), CameraMount(),
)  # fmt: skip

#: Pixels a square has in the flat picture of the board, and rays a pixel has in each direction.
_SQUARE_PX = 24
_FINE = 2


def rotation_z(angle: float) -> Array:
    """Rotate about z, right-handed, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class BoardPose:
    """Where the board is: optical_from_board, its middle at `centre` [m]."""

    tilt_x: float
    tilt_y: float
    turn: float
    centre: tuple[float, float, float]

    @property
    def rotation(self) -> Array:
        return rotation_x(self.tilt_x) @ rotation_y(self.tilt_y) @ rotation_z(self.turn)


def poses(
    camera: Camera, board: Board, count: int, rng: np.random.Generator, tilt: float = 0.6
) -> list[BoardPose]:
    """Return poses at which the whole board is in the picture, tilted and spread over it."""
    found: list[BoardPose] = []
    width = board.squares[0] * board.square_m
    while len(found) < count:
        middle = rng.uniform([0.15, 0.15], [0.85, 0.85]) * [camera.width, camera.height]
        depth = width * camera.focal_px / camera.width * rng.uniform(1.2, 2.2)
        ray = np.append(camera.undistort(middle[None])[0], 1.0)
        angles = rng.uniform(-tilt, tilt, 3)
        x, y, z = ray / np.linalg.norm(ray) * depth
        pose = BoardPose(*angles.tolist(), (float(x), float(y), float(z)))
        if _inside(camera, board, pose):
            found.append(pose)
    return found


def corner_views(
    camera: Camera, board: Board, count: int, rng: np.random.Generator, noise: float, tilt: float = 0.6
) -> dict[str, Corners]:
    """Return the corners of views that nobody drew, by name, with noise on both coordinates [px]."""
    places = poses(camera, board, count, rng, tilt)
    seen = [corners_px(camera, board, pose) for pose in places]
    return {
        f"view{index}": Corners(board.corners_m, corners + rng.normal(0.0, noise, corners.shape))
        for index, corners in enumerate(seen)
    }


def corners_px(camera: Camera, board: Board, pose: BoardPose) -> Array:
    """Return where the inner corners truly are, row by row, raw pixels."""
    return _project(camera, _centred(board, board.corners_m), pose)


def draw_board(
    camera: Camera, board: Board, pose: BoardPose, rng: np.random.Generator, noise: float = 2.0
) -> GreyImage:
    """Return the picture: the board on grey, blurred by 0.7 px, with noise of some grey levels."""
    flat = _flat(board)
    rays = _rays(camera) @ pose.rotation
    centre = np.array(pose.centre) @ pose.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        places = rays[:, :2] * (centre[2] / rays[:, 2:]) - centre[:2]
    margin = (np.array(flat.shape[::-1]) - np.array(board.squares) * _SQUARE_PX) / 2
    middle = np.array(board.squares) / 2 * _SQUARE_PX + margin - 0.5
    places = (places / board.square_m * _SQUARE_PX + middle).astype(np.float32)
    places[~np.isfinite(places) | (np.abs(places) > 1e4)] = -1e4
    grid = places.reshape(_FINE * camera.height, _FINE * camera.width, 2)
    fine = cv2.remap(flat, grid[..., 0].copy(), grid[..., 1].copy(), cv2.INTER_LINEAR, borderValue=120.0)
    image = cv2.GaussianBlur(
        cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA), (0, 0), 0.7
    )
    noisy = 40.0 + 0.6 * image + rng.normal(0.0, noise, image.shape)
    grey: GreyImage = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return grey


@cache
def _rays(camera: Camera) -> Array:
    """Return the direction of every ray, optical frame, (n, 3)."""
    u, v = (np.arange(_FINE * size) / _FINE - 0.5 + 0.5 / _FINE for size in (camera.width, camera.height))
    raw = np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)
    return np.column_stack([camera.undistort(raw), np.ones(len(raw))])


def _flat(board: Board) -> Array:
    """Return the board seen straight on, with a white margin of a square."""
    columns, rows = board.squares
    if isinstance(board, Charuco):
        size = (_SQUARE_PX * columns, _SQUARE_PX * rows)
        inner = board.pattern().generateImage(size, marginSize=0)
    else:
        dark = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
        inner = np.kron(np.where(dark, 0, 255), np.ones((_SQUARE_PX, _SQUARE_PX)))
    return np.pad(inner.astype(np.float32), _SQUARE_PX, constant_values=255.0)


def _centred(board: Board, points_m: Array) -> Array:
    return points_m - np.append(np.array(board.squares) * board.square_m / 2, 0.0)


def _inside(camera: Camera, board: Board, pose: BoardPose) -> bool:
    columns, rows = (count * board.square_m for count in board.squares)
    outline = np.array([[0, 0, 0], [columns, 0, 0], [columns, rows, 0], [0, rows, 0]])
    points = _centred(board, outline) @ pose.rotation.T + pose.centre
    if points[:, 2].min() <= 0.0:
        return False
    pixels = _project(camera, _centred(board, outline), pose)
    return bool((pixels > 3).all() and (pixels < [camera.width - 4, camera.height - 4]).all())


def _project(camera: Camera, points: Array, pose: BoardPose) -> Array:
    optical = points @ pose.rotation.T + pose.centre
    return camera.distort(optical[:, :2] / optical[:, 2:])
