"""The pose that explains matched lines best: Levenberg-Marquardt with analytic Jacobian and covariance.

A calling convention: for a matched pair, with N = (p - T) x v the interpretation-plane normal of the map
segment in the map frame and n = R^T N the same in the optical frame, the signed distance in pixels of an
image point q = (u, v, f) from the predicted line is

    r = n . q / |(n_x, n_y)|

which is zero for an exact pose and noise-free lines. Planar pose (x, y, phi) is estimated together with
the camera's height, pitch, roll and yaw, which have priors from the robot's file: their errors dominate
at sub-pixel noise and would otherwise be taken for certainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.poses import Array, Pose2
from vision.camera import BASE_FROM_OPTICAL, CameraMount, rotation_x, rotation_y, rotation_z

#: Degrees of freedom of the residuals' Student distribution: its weights fall off with the square of the
#: distance, so a neighbouring edge taken for the right one hardly pulls.
_STUDENT = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class LineObservations:
    """K matched lines, as the estimator sees them.

    `moments`, `directions`: (K, 3) p x v and v of each map segment, with p a point and v its unit direction,
    map frame.
    `rays`: (K, 2, 3) the image line's end points as (u, v, f), ideal pixels.
    `sigma_middle_px`, `sigma_slope_px`: (K,) standard deviations of the half sum and of the half difference
    of the end points' distances from the predicted line: image noise, and the map's own uncertainty.
    """

    moments: Array
    directions: Array
    rays: Array
    sigma_middle_px: Array
    sigma_slope_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """A pose, its covariance (3, 3) over (x, y, phi), and how the residuals spread against expectation.

    `spread`: median absolute deviation of the lines' middles, as standard deviations over those expected.
    """

    pose: Pose2
    covariance: Array
    spread: float


def distances_and_jacobian(state: Array, mount: CameraMount, seen: LineObservations) -> tuple[Array, Array]:
    """Return the end points' distances (K, 2) in pixels and their derivatives (K, 2, 7).

    `state`: (7,) x, y, phi, and the deviations of height, pitch, roll and yaw from the mount's.
    """
    x, y, phi, height, pitch, roll, yaw = state
    heading = rotation_z(phi + mount.yaw_rad + yaw)
    nod = heading @ rotation_y(mount.pitch_down_rad + pitch)
    rotation = nod @ rotation_x(mount.roll_rad + roll) @ BASE_FROM_OPTICAL
    lever = rotation_z(phi) @ [mount.x_m, mount.y_m, 0.0]
    centre = lever + [x, y, mount.height_m + height]

    # N = (p - T) x v, and its derivatives: v x dT for a moving centre, N x w for a turn about an axis w;
    # a row vector times skew(a) is its cross product with a.
    normal_map = seen.moments + seen.directions @ _skew(centre)
    up, side, forward = np.array([0.0, 0.0, 1.0]), heading[:, 1], nod[:, 0]
    moves = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([-lever[1], lever[0], 0.0]), up)
    moved = seen.directions @ np.hstack([_skew(axis) @ rotation for axis in moves])
    turned = normal_map @ np.hstack([_skew(axis) @ rotation for axis in (up, side, forward)])
    normal = normal_map @ rotation
    normal_slopes = np.empty((len(normal), 7, 3))
    normal_slopes[:, :4] = moved.reshape(-1, 4, 3)
    normal_slopes[:, 2] += turned[:, :3]
    normal_slopes[:, 4:6] = turned[:, 3:].reshape(-1, 2, 3)
    normal_slopes[:, 6] = turned[:, :3]

    scale = np.maximum(np.linalg.norm(normal[:, :2], axis=1), 1e-12)
    distances = (seen.rays @ normal[:, :, None])[..., 0] / scale[:, None]
    stretch = (normal_slopes[..., :2] @ normal[:, :2, None])[..., 0] / scale[:, None] ** 2
    jacobian = seen.rays @ normal_slopes.transpose(0, 2, 1) / scale[:, None, None]
    jacobian -= distances[..., None] * stretch[:, None, :]
    return distances, jacobian


def estimate_pose(
    start: Pose2, mount: CameraMount, seen: LineObservations, max_iterations: int = 12
) -> PoseEstimate:
    """Maximise the likelihood of the distances, Student distributed, by Levenberg-Marquardt from `start`."""
    prior_std = np.array(
        [mount.std_height_m, mount.std_pitch_down_rad, mount.std_roll_rad, mount.std_yaw_rad]
    )
    prior = np.zeros((7, 7))
    prior[3:, 3:] = np.diag(np.maximum(prior_std, 1e-6) ** -2)
    sigma = np.column_stack([seen.sigma_middle_px, seen.sigma_slope_px]).ravel()

    def linearise(state: Array) -> tuple[float, Array, Array]:
        distances, jacobian = distances_and_jacobian(state, mount, seen)
        residual = _middle_and_slope(distances).ravel() / sigma
        slope = _middle_and_slope(jacobian).reshape(-1, 7) / sigma[:, None]
        weight = (_STUDENT + 1.0) / (_STUDENT + residual**2)
        surprise = 0.5 * (_STUDENT + 1.0) * np.log1p(residual**2 / _STUDENT).sum()
        nuisance = state[3:]
        cost = float(surprise + 0.5 * nuisance @ prior[3:, 3:] @ nuisance)
        gradient = slope.T @ (weight * residual) + prior @ np.r_[0.0, 0.0, 0.0, nuisance]
        return cost, gradient, slope.T @ (weight[:, None] * slope) + prior

    state = np.r_[start.as_array(), np.zeros(4)]
    cost, gradient, information = linearise(state)
    damping = 1e-4
    for _ in range(max_iterations):
        ridge = damping * np.diag(np.maximum(np.diag(information), 1e-9))
        step = -np.linalg.solve(information + ridge, gradient)
        trial = linearise(state + step)
        if trial[0] <= cost:
            settled = cost - trial[0] < 1e-4
            state, (cost, gradient, information) = state + step, trial
            damping = max(0.1 * damping, 1e-9)
            if settled:
                break
        else:
            damping *= 10.0
    # A direction that nothing constrains must show as a long axis, not as a crash.
    covariance = np.linalg.inv(information + np.diag([1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0, 0.0]))[:3, :3]
    distances, _ = distances_and_jacobian(state, mount, seen)
    spread = float(np.median(np.abs(_middle_and_slope(distances)[:, 0]) / seen.sigma_middle_px) / 0.6745)
    return PoseEstimate(Pose2.from_array(state[:3]), 0.5 * (covariance + covariance.T), spread)


def student_log_density(distance: Array, sigma: Array) -> Array:
    """Return the log density of distances under the estimator's noise, scaled by sigma; any shape."""
    peak = math.lgamma(0.5 * (_STUDENT + 1.0)) - math.lgamma(0.5 * _STUDENT)
    peak -= 0.5 * math.log(math.pi * _STUDENT)
    tail: Array = peak - np.log(sigma) - 0.5 * (_STUDENT + 1.0) * np.log1p((distance / sigma) ** 2 / _STUDENT)
    return tail


def _skew(a: Array) -> Array:
    """The matrix of the cross product: _skew(a) @ b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _middle_and_slope(ends: Array) -> Array:
    """Turn values at two ends, (K, 2, ...), into their half sum and half difference, (K, 2, ...)."""
    return np.stack([ends[:, 0] + ends[:, 1], ends[:, 1] - ends[:, 0]], axis=1) * 0.5
