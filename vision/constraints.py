"""Unary constraints: which image line can be which map segment, from inside a search window.

Section 3.2 of the paper, in this project's frames. With n the normal of an image line's interpretation
plane, turned into the level frame of the camera (x forward along the heading psi, z up), v the direction
of a map segment and p a point of it:

    (1.a)  n . Rz(-psi) v = 0          (1.b)  n . Rz(-psi) (p - T) = 0

(1.a) is a cos psi + b sin psi + c = 0 and gives the heading (2.a); at that heading (1.b) is a line in the
plan on which the camera's centre T lies (2.b). A vertical segment has no say in the heading: its image
must pass through the vertical vanishing point, and its bearing must fit the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2, wrap_angle
from maps.wiremap import WireMap
from vision.camera import BASE_FROM_OPTICAL, Camera, rotation_x, rotation_y
from vision.lines import ImageSegments
from vision.projection import Prediction

#: Standard deviations allowed for noise in a test.
SIGMAS = 3.0
#: An edge this close to the vertical (cosine) says nothing about the heading.
VERTICAL_COSINE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """C pairs of a map segment and an image line that pass the unary tests.

    `rows`: (C,) of the wire map, `lines`: (C,) of the image segments. `phi`: (C,) the robot's heading that
    the pair implies, NaN for vertical segments. `normals_level`: (C, 3) unit interpretation-plane normals in
    the camera's level frame. `points`: (C, 3) a point of each map segment, map frame.
    """

    rows: NDArray[np.int64]
    lines: NDArray[np.int64]
    phi: Array
    normals_level: Array
    points: Array

    def __len__(self) -> int:
        return len(self.rows)


def level_normals(camera: Camera, segments: ImageSegments) -> Array:
    """Return the interpretation-plane normals (M, 3) of image lines in the camera's level frame."""
    rays = np.concatenate([segments.ideal_px, np.full((len(segments), 2, 1), camera.focal_px)], axis=2)
    normals = np.cross(rays[:, 0], rays[:, 1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    result: Array = normals @ level_from_optical(camera).T
    return result


def level_from_optical(camera: Camera) -> Array:
    """Return the rotation (3, 3) from the optical frame into the camera's level frame."""
    mount = camera.mount
    return rotation_y(mount.pitch_down_rad) @ rotation_x(mount.roll_rad) @ BASE_FROM_OPTICAL


def segment_lines(wire_map: WireMap, rows: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return unit directions (K, 3) and middles (K, 3) of map segments: v and p of equation (1)."""
    direction = wire_map.endpoints[rows, 1] - wire_map.endpoints[rows, 0]
    return direction / np.linalg.norm(direction, axis=1)[:, None], wire_map.endpoints[rows].mean(axis=1)


def upright(directions: Array) -> NDArray[np.bool_]:
    """Return which unit directions (..., 3) are vertical."""
    result: NDArray[np.bool_] = np.hypot(directions[..., 0], directions[..., 1]) < VERTICAL_COSINE
    return result


def heading_terms(normals: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return a, b, c of equation (2.a), a cos psi + b sin psi + c = 0; inputs broadcast, (..., 3) each."""
    a = normals[..., 0] * directions[..., 0] + normals[..., 1] * directions[..., 1]
    b = normals[..., 0] * directions[..., 1] - normals[..., 1] * directions[..., 0]
    return a, b, normals[..., 2] * directions[..., 2]


def heading_roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Solve equation (2.a): the heading psi is middle +- spread, radians, (...) each.

    Where there is no real root the spread is 0 or pi: the heading that comes nearest.
    """
    r = np.maximum(np.hypot(a, b), 1e-12)
    return np.arctan2(b, a), np.arccos(np.clip(-c / r, -1.0, 1.0))


def unary_correspondences(
    camera: Camera,
    wire_map: WireMap,
    segments: ImageSegments,
    predicted: Prediction,
    window: SearchWindow,
) -> Correspondences:
    """Return the pairs of predicted map segments and image lines that some pose of the window explains.

    `predicted`: the pieces visible from the window; a pair must also lie where the window can move them to.
    """
    piece, line = np.nonzero(_within_reach(camera, segments, predicted, window))
    rows = predicted.rows[piece]
    normals = level_normals(camera, segments)[line]
    noise = _angular_noise(camera, segments)[line]
    direction, points = segment_lines(wire_map, rows)

    vertical = upright(direction)
    through_zenith = np.abs(normals[:, 2]) <= SIGMAS * noise
    keep, phi = np.zeros(len(rows), bool), np.full(len(rows), window.centre.phi)
    for root, phi_ok in _heading_test(normals, direction, noise, camera.mount.yaw_rad, window):
        phi = np.where(keep | vertical, phi, root)
        near = _line_meets_disc(camera, normals, points, phi, noise, vertical, window)
        keep |= np.where(vertical, through_zenith, phi_ok) & near
    found = Correspondences(
        rows[keep], line[keep], np.where(vertical, np.nan, phi)[keep], normals[keep], points[keep]
    )
    return _distinct(found)


def _within_reach(
    camera: Camera, segments: ImageSegments, predicted: Prediction, window: SearchWindow
) -> NDArray[np.bool_]:
    """Whether the window can bring each piece over each line's middle, with like slopes: (P, M)."""
    depth = np.maximum(predicted.depths_m.min(axis=1), window.dt_m + 0.5)
    farthest = predicted.depths_m.max(axis=1)
    # A turn moves the rim of a wide image much farther than its middle.
    rim = 1.0 + ((predicted.ideal_px / camera.focal_px) ** 2).sum(axis=2).max(axis=1)
    turn = np.maximum(rim, 1.2) * window.dphi_rad
    shift = camera.focal_px * (turn + window.dt_m / (depth - window.dt_m)) + 10.0
    start, end = predicted.ideal_px[:, 0], predicted.ideal_px[:, 1]
    along = (end - start) / predicted.lengths_px[:, None]
    # Coordinates along and across each piece, as products of small matrices: no (P, M, 2) in between.
    across_way = along[:, ::-1] * [-1.0, 1.0]
    middles = segments.ideal_px.mean(axis=1).T
    position = along @ middles - (along * start).sum(axis=1)[:, None]
    across = np.abs(across_way @ middles - (across_way * start).sum(axis=1)[:, None])
    beyond = np.maximum(np.maximum(-position, position - predicted.lengths_px[:, None]), 0.0)
    direction = segments.ideal_px[:, 1] - segments.ideal_px[:, 0]
    direction = direction / segments.lengths_px[:, None]
    cosine = np.abs(along @ direction.T)
    # A step moves the near end farther than the far end, and so turns the image of an edge; a turn of the
    # robot does, too, off the middle of the image: twice the heading is ample.
    parallax = camera.focal_px * window.dt_m * (1.0 / depth - 1.0 / np.maximum(farthest, depth))
    turned = np.arctan2(parallax, predicted.lengths_px)
    slack = np.minimum(np.radians(10.0) + 2.0 * window.dphi_rad + turned, np.pi / 2)
    result: NDArray[np.bool_] = (np.hypot(across, beyond) <= shift[:, None]) & (
        cosine >= np.cos(slack)[:, None]
    )
    return result


def _angular_noise(camera: Camera, segments: ImageSegments) -> Array:
    """Standard deviation of an interpretation plane's direction (M,), rad: end points, and tilt."""
    ends = 2.0 * segments.sigma_px / segments.lengths_px
    tilt = np.hypot(camera.mount.std_pitch_down_rad, camera.mount.std_roll_rad)
    result: Array = np.hypot(ends, tilt)
    return result


def _heading_test(
    normals: Array, direction: Array, noise: Array, yaw: float, window: SearchWindow
) -> list[tuple[Array, NDArray[np.bool_]]]:
    """Equation (2.a): its two roots (C,), that nearer to the window's heading first; whether inside."""
    a, b, c = heading_terms(normals, direction)
    r = np.maximum(np.hypot(a, b), 1e-12)
    middle, spread = heading_roots(a, b, c)
    roots = middle[:, None] + spread[:, None] * [1.0, -1.0] - yaw
    away = wrap_angle(roots - window.centre.phi)
    away = np.take_along_axis(away, np.abs(away).argsort(axis=1), axis=1).T
    # d(2.a)/dpsi at a root is r sin(spread): small for lines near the horizon, which say little.
    tolerance = SIGMAS * noise / np.maximum(r * np.abs(np.sin(spread)), 1e-3)
    real = np.abs(c) <= r + SIGMAS * noise
    clipped = np.clip(away, -window.dphi_rad, window.dphi_rad)
    inside = real & (np.abs(away - clipped) <= tolerance)
    return list(zip(wrap_angle(window.centre.phi + clipped), inside, strict=True))


def position_lines(camera: Camera, normals: Array, points: Array, phi: Array) -> tuple[Array, Array]:
    """Equation (2.b): the plan lines on which the camera's centre lies if the heading is phi.

    Returns unit normals (C, 2) and offsets (C,): normal . T = offset, metres, map frame.
    """
    psi = phi + camera.mount.yaw_rad
    cos, sin = np.cos(psi), np.sin(psi)
    plan = np.column_stack(
        [cos * normals[:, 0] - sin * normals[:, 1], sin * normals[:, 0] + cos * normals[:, 1]]
    )
    scale = np.maximum(np.linalg.norm(plan, axis=1), 1e-9)
    drop = normals[:, 2] * (points[:, 2] - camera.mount.height_m)
    offsets = ((plan * points[:, :2]).sum(axis=1) + drop) / scale
    return plan / scale[:, None], offsets


def camera_centre(camera: Camera, pose: Pose2) -> Array:
    """Return the camera's centre in plan, (2,), map frame."""
    centre = pose @ Pose2(camera.mount.x_m, camera.mount.y_m, 0.0)
    return np.array([centre.x, centre.y])


def _line_meets_disc(
    camera: Camera,
    normals: Array,
    points: Array,
    phi: Array,
    noise: Array,
    vertical: NDArray[np.bool_],
    window: SearchWindow,
) -> NDArray[np.bool_]:
    """Whether the position line of each pair meets the window's disc, (C,); for a vertical its sector."""
    line, offset = position_lines(camera, normals, points, phi)
    centre = camera_centre(camera, window.centre)
    distance = np.abs(line @ centre - offset)
    range_m = np.linalg.norm(points - [*centre, camera.mount.height_m], axis=1)
    lever = np.hypot(camera.mount.x_m, camera.mount.y_m)
    horizontal = np.maximum(np.linalg.norm(normals[:, :2], axis=1), 1e-3)
    slack = SIGMAS * noise * range_m / horizontal + lever * window.dphi_rad
    turning = np.where(vertical, range_m * np.sin(min(window.dphi_rad, np.pi / 2)), 0.0)
    result: NDArray[np.bool_] = distance <= window.dt_m + slack + turning
    return result


def _distinct(found: Correspondences) -> Correspondences:
    """Drop repeats of a pair, which occur where a segment is seen in several pieces."""
    lines = int(found.lines.max(initial=0)) + 1
    _, first = np.unique(found.rows * lines + found.lines, return_index=True)
    return Correspondences(
        found.rows[first],
        found.lines[first],
        found.phi[first],
        found.normals_level[first],
        found.points[first],
    )
