"""The calibrated camera: intrinsics, distortion, and where it sits on the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from maps.poses import Array, Pose2, frozen


class CameraModel(StrEnum):
    """How a ray becomes a pixel; the values are those of robot.yaml."""

    PINHOLE_RADTAN = "pinhole_radtan (OpenCV)"
    FISHEYE = "fisheye (OpenCV)"


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where the camera sits on the robot, and how well that is known.

    Metres and radians in the robot's base frame; pitch positive downwards, yaw positive to the left,
    roll about the optical axis. robot_from_camera rotates by Rz(yaw) Ry(pitch) Rx(roll).
    """

    x_m: float = 0.0
    y_m: float = 0.0
    height_m: float = 1.0
    pitch_down_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    std_height_m: float = 0.005
    std_pitch_down_rad: float = 0.003
    std_yaw_rad: float = 0.003
    std_roll_rad: float = 0.003


#: Columns: the optical axes (x right, y down, z forward) in a level, forward-looking base frame.
BASE_FROM_OPTICAL = frozen(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


#: A camera that looks farther up or down than this is taken for one in another convention of frames.
STEEPEST_RAD = 1.4


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A camera with OpenCV's pinhole or fisheye distortion; integer pixels are pixel centres.

    `std_focal`: how well the focal length is known, relative; `std_centre_px`: the same of (cx, cy).
    """

    model: CameraModel
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Array
    mount: CameraMount
    std_focal: float = 0.0
    std_centre_px: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "distortion", frozen(self.distortion))

    @property
    def matrix(self) -> Array:
        """The intrinsic matrix K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def focal_px(self) -> float:
        """The focal length of the ideal camera that undistorted pixels refer to."""
        return math.sqrt(self.fx * self.fy)

    def undistort(self, points_px: Array) -> Array:
        """Turn raw pixels (N, 2) into normalised image coordinates (x/z, y/z), (N, 2)."""
        points = np.ascontiguousarray(points_px, np.float64).reshape(-1, 1, 2)
        if not len(points):
            return np.zeros((0, 2))
        if self.model is CameraModel.FISHEYE:
            rays = cv2.fisheye.undistortPoints(points, self.matrix, self.distortion)
        elif self.distortion.any():
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)
            rays = cv2.undistortPoints(points, self.matrix, self.distortion, criteria=criteria)
        else:
            rays = (points - [self.cx, self.cy]) / [self.fx, self.fy]
        return np.asarray(rays, np.float64).reshape(-1, 2)

    def distort(self, points: Array) -> Array:
        """Turn normalised image coordinates (N, 2) into raw pixels (N, 2)."""
        if not len(points):
            return np.zeros((0, 2))
        if self.model is not CameraModel.FISHEYE and not self.distortion.any():
            return np.asarray(points) * [self.fx, self.fy] + [self.cx, self.cy]
        rays = np.column_stack([points, np.ones(len(points))]).reshape(-1, 1, 3)
        zero = np.zeros(3)
        project = cv2.fisheye.projectPoints if self.model is CameraModel.FISHEYE else cv2.projectPoints
        pixels = project(rays, zero, zero, self.matrix, self.distortion)[0]
        return np.asarray(pixels, np.float64).reshape(-1, 2)

    @property
    def area_px(self) -> float:
        """Pixels of the image."""
        return float(self.width * self.height)

    @property
    def shift_px(self) -> float:
        """How far the doubts about tilt, focal length and principal point may shift the picture, one deviation."""
        tilt = math.hypot(self.mount.std_pitch_down_rad, self.mount.std_roll_rad)
        rim = 0.25 * (self.width + self.height)
        return math.hypot(self.focal_px * tilt, self.std_focal * rim, self.std_centre_px)

    def map_from_optical(self, map_from_robot: Pose2, deviations: Array | None = None) -> tuple[Array, Array]:
        """Return the rotation (3, 3) and the camera's centre (3,) in the map frame.

        `deviations`: of height, pitch, roll and yaw from the mount's (and more, which is ignored); none if not given.
        """
        mount = self.mount
        height, pitch, roll, yaw = (0.0, 0.0, 0.0, 0.0) if deviations is None else deviations[:4]
        psi, phi = map_from_robot.phi + mount.yaw_rad + yaw, map_from_robot.phi
        pitch, roll = mount.pitch_down_rad + pitch, mount.roll_rad + roll
        c, s, cp, sp = math.cos(psi), math.sin(psi), math.cos(pitch), math.sin(pitch)
        cr, sr = math.cos(roll), math.sin(roll)
        # Rz(psi) Ry(pitch) Rx(roll) of the level camera's axes, written out: every prediction comes by here.
        rotation = np.array(
            [
                [s * cr - c * sp * sr, -c * sp * cr - s * sr, c * cp],
                [-s * sp * sr - c * cr, c * sr - s * sp * cr, s * cp],
                [-cp * sr, -cp * cr, -sp],
            ]
        )
        cos, sin = math.cos(phi), math.sin(phi)
        centre = np.array(
            [
                map_from_robot.x + cos * mount.x_m - sin * mount.y_m,
                map_from_robot.y + sin * mount.x_m + cos * mount.y_m,
                mount.height_m + height,
            ]
        )
        return rotation, centre


def mount_of(base_from_level: Array, place: Array) -> CameraMount:
    """Return the mount of a camera at `place` (3,) [m] whose level, forward-looking frame is turned so, (3, 3).

    `base_from_level` is base_from_optical @ BASE_FROM_OPTICAL.T. ValueError where it looks straight up or down, or is
    not above the floor: no robot's camera, but another convention of frames.
    """
    pitch = math.asin(float(np.clip(-base_from_level[2, 0], -1.0, 1.0)))
    if abs(pitch) > STEEPEST_RAD:
        raise ValueError("looks straight up or down: no optical frame (z forward)")
    if not place[2] > 0.0:
        raise ValueError(f"is {place[2]:.2f} m above the floor")
    yaw = math.atan2(base_from_level[1, 0], base_from_level[0, 0])
    roll = math.atan2(base_from_level[2, 1], base_from_level[2, 2])
    x, y, z = place.tolist()
    return CameraMount(x, y, z, pitch, yaw, roll)


def rotation_x(angle: float) -> Array:
    """Rotate about x, right-handed, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle: float) -> Array:
    """Rotate about y, right-handed, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
