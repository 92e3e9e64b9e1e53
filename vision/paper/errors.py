"""How far image lines can be wrong: errors of interpretation planes and of bearings (section 3.4).

The sources: each line's own offset and direction; and, the same for all lines of an image, focal length,
principal point and tilt. Section 4.1 models these; here they come with the camera and the segments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maps.poses import Array
from vision.camera import Camera, rotation_y
from vision.constraints import level_from_optical, level_normals
from vision.lines import ImageSegments


@dataclass(frozen=True, slots=True, eq=False)
class LineErrors:
    """M image lines in the camera's level frame (x forward, y left, z up), with their errors.

    `normals`: (M, 3) unit normals of the interpretation planes. `own`: (M, 2, 3) what one standard deviation of
    the line's offset and of its direction adds to the normal; `shared`: (M, 5, 3) the same for focal length,
    principal point (u, v), pitch and roll. `covariances`: (M, 3, 3) of the normals, all together.
    """

    normals: Array
    own: Array
    shared: Array
    covariances: Array

    def __len__(self) -> int:
        return len(self.normals)


@dataclass(frozen=True, slots=True, eq=False)
class Bearings:
    """Where M image lines would be seen if they are images of vertical edges.

    `bearings`: (M,) radians to the left of straight ahead; `own`: (M,) standard deviation by the line's own
    error; `shared`: (M, 5) what one standard deviation of each shared error adds, as in `LineErrors`.
    """

    bearings: Array
    own: Array
    shared: Array


def line_errors(camera: Camera, segments: ImageSegments) -> LineErrors:
    """Return the interpretation planes of image lines with their errors, to first order."""
    normals = level_normals(camera, segments)
    level = level_from_optical(camera)
    optical = normals @ level
    pivots, along, across = _pivots(camera, segments)
    length = np.linalg.norm(np.cross(pivots, along), axis=1)[:, None]
    own = np.stack(
        [
            segments.sigma_middle_px[:, None] * np.cross(across, along) / length,
            segments.sigma_angle_rad[:, None] * np.cross(pivots, across) / length,
        ],
        axis=1,
    )
    inner = np.zeros((len(segments), 3, 3))
    # A focal length too small by a share: n_f / (1 + share). A centre too far right: n_f + n_u shift / f.
    inner[:, 0, 2] = -camera.std_focal * optical[:, 2]
    inner[:, 1:, 2] = camera.std_centre_px / camera.focal_px * optical[:, :2]
    tilted = [std * np.cross(axis, normals) for axis, std in _tilts(camera)]
    shared = np.concatenate([inner @ level.T, np.stack(tilted, axis=1)], axis=1)
    own, shared = (_across(slopes, normals) for slopes in (own @ level.T, shared))
    both = np.concatenate([own, shared], axis=1)
    return LineErrors(normals, own, shared, np.einsum("msi,msj->mij", both, both))


def bearings_of(camera: Camera, segments: ImageSegments) -> Bearings:
    """Return the bearings of lines taken for vertical edges, at any tilt: equations (3), (5), (6).

    Any point of a vertical edge's image has the edge's bearing in a virtual level camera. The paper takes the
    point on the horizon, which a line far above or below knows badly; here it is the point that the line knows
    best, its pivot.
    """
    level = level_from_optical(camera)
    pivots, _, across = _pivots(camera, segments)
    rays = pivots @ level.T
    count = len(segments)
    moves = np.zeros((count, 6, 3))
    moves[:, 0] = segments.sigma_middle_px[:, None] * (across @ level.T)
    moves[:, 1] = camera.std_focal * camera.focal_px * level[:, 2]
    moves[:, 2] = -camera.std_centre_px * level[:, 0]
    moves[:, 3] = -camera.std_centre_px * level[:, 1]
    for place, (axis, std) in enumerate(_tilts(camera), start=4):
        moves[:, place] = std * np.cross(axis, rays)
    flat = (rays[:, :2] ** 2).sum(axis=1)[:, None]
    turns = (rays[:, None, 0] * moves[..., 1] - rays[:, None, 1] * moves[..., 0]) / flat
    return Bearings(np.arctan2(rays[:, 1], rays[:, 0]), np.abs(turns[:, 0]), turns[:, 1:])


def _pivots(camera: Camera, segments: ImageSegments) -> tuple[Array, Array, Array]:
    """The pivots as rays (u, v, f), the unit directions along the lines and across, (M, 3) each, optical."""
    ends = segments.ideal_px
    along = (ends[:, 1] - ends[:, 0]) / np.maximum(segments.lengths_px, 1e-9)[:, None]
    points = ends.mean(axis=1) + segments.pivot_px[:, None] * along
    zero = np.zeros((len(segments), 1))
    across = np.column_stack([-along[:, 1], along[:, 0], zero])
    return np.hstack([points, zero + camera.focal_px]), np.hstack([along, zero]), across


def _tilts(camera: Camera) -> tuple[tuple[Array, float], tuple[Array, float]]:
    """The axes of pitch and of roll in the level frame, (3,) each, with their standard deviations."""
    mount = camera.mount
    forward = rotation_y(mount.pitch_down_rad)[:, 0]
    return (np.array([0.0, 1.0, 0.0]), mount.std_pitch_down_rad), (forward, mount.std_roll_rad)


def _across(slopes: Array, normals: Array) -> Array:
    """Slopes (M, S, 3) without their parts along the normals, which stay unit vectors."""
    result: Array = slopes - (slopes @ normals[:, :, None]) * normals[:, None, :]
    return result
