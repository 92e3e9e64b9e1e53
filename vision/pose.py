"""The pose that explains matched lines best: Levenberg-Marquardt with analytic Jacobian and covariance.

A calling convention: for a matched pair, with N = (p - T) x v the interpretation-plane normal of the map
segment in the map frame and n = R^T N the same in the optical frame, the signed distance in pixels of an
image point q = (u, v, f) from the predicted line is

    r = n . q' / |(n_x, n_y)|        q' = (u - c_u, v - c_v, f (1 + s))

which is zero for an exact pose and noise-free lines. Planar pose (x, y, phi) is estimated together with
what is known about the camera only roughly, each with a prior from the robot's file: height, pitch, roll and
yaw, the relative error s of the focal length and the error (c_u, c_v) of the principal point. At sub-pixel
noise their errors dominate, and would otherwise be taken for certainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.poses import Array, Pose2
from vision.camera import Camera
from vision.linecost import STATES, covariance_of, innovations, linearise, maximise, shifts

#: Degrees of freedom of the residuals' Student distribution where nobody says: its weights fall off with the
#: square of the distance, so a neighbouring edge taken for the right one hardly pulls. Gaussian noise has many.
STUDENT = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class LineObservations:
    """K matched lines, as the estimator sees them.

    `moments`, `directions`: (K, 3) p x v and v of each map segment, with p a point and v its unit direction,
    map frame.
    `rays`: (K, 2, 3) two points of the image line as (u, v, f), ideal pixels: its ends, or points as far
    apart about the place where the errors of offset and direction are independent.
    `sigma_middle_px`, `sigma_slope_px`: (K,) standard deviations of the half sum and of the half difference
    of the two points' distances from the predicted line: image noise, and the map's own uncertainty.
    `credence`: (K,) how likely each pair is right, which its log likelihood is multiplied with; all 1 if not given.
    """

    moments: Array
    directions: Array
    rays: Array
    sigma_middle_px: Array
    sigma_slope_px: Array
    credence: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """A pose, its uncertainty, and how the residuals spread against expectation.

    `state`: (10,) the pose and the camera's deviations, `state_covariance`: (10, 10).
    `spread`: median absolute deviation of the lines'
    middles, as standard deviations over those expected.
    """

    pose: Pose2
    state: Array
    state_covariance: Array
    spread: float

    @property
    def covariance(self) -> Array:
        """The covariance (3, 3) of (x, y, phi)."""
        return self.state_covariance[:3, :3]


def distances_and_jacobian(state: Array, camera: Camera, seen: LineObservations) -> tuple[Array, Array]:
    """Return the two points' distances (K, 2) in pixels and their derivatives (K, 2, 10).

    `state`: (10,) x, y, phi, and the deviations of height, pitch, roll, yaw, focal length (relative) and principal
    point (u, v) from the camera's.
    """
    distances, jacobian = np.empty((len(seen.rays), 2)), np.empty((len(seen.rays), 2, STATES))
    linearise(state, _mount(camera), seen.moments, seen.directions, seen.rays, distances, jacobian)
    return distances, jacobian


def estimate_pose(
    start: Pose2,
    camera: Camera,
    seen: LineObservations,
    student: float = STUDENT,
    max_iterations: int = 12,
    deviations: Array | None = None,
) -> PoseEstimate:
    """Maximise the likelihood of the distances by Levenberg-Marquardt from `start`.

    They are Student distributed, with `student` degrees of freedom. `deviations`: (7,) of the camera, to start from.
    """
    state = np.zeros(STATES)
    state[:3] = start.as_array()
    if deviations is not None:
        state[3:] = deviations
    state, covariance, spread = maximise(
        state,
        _mount(camera),
        nuisance_information(camera),
        seen.moments,
        seen.directions,
        seen.rays,
        seen.sigma_middle_px,
        seen.sigma_slope_px,
        np.ones(len(seen.rays)) if seen.credence is None else seen.credence,
        student,
        max_iterations,
    )
    return PoseEstimate(Pose2.from_array(state[:3]), state, covariance, float(spread))


def predicted_sigma_px(
    estimate: PoseEstimate, camera: Camera, moments: Array, directions: Array, rays: Array
) -> Array:
    """Return how far the estimate's own uncertainty may shift each of K predicted lines, one deviation, (K,).

    At the worse of the line's two points, `rays` (K, 2, 3); see `LineObservations` for the arrays.
    """
    result: Array = shifts(
        estimate.state, estimate.state_covariance, _mount(camera), moments, directions, rays
    )
    return result


def squared_innovations(estimate: PoseEstimate, camera: Camera, seen: LineObservations) -> Array:
    """Return the normalised squared innovation of each of K lines, (K,), chi-square with 2 degrees of freedom.

    Of offset and direction together, against the noise and the estimate's own uncertainty.
    """
    result: Array = innovations(
        estimate.state,
        estimate.state_covariance,
        _mount(camera),
        seen.moments,
        seen.directions,
        seen.rays,
        seen.sigma_middle_px,
        seen.sigma_slope_px,
    )
    return result


def pose_bound(pose: Pose2, camera: Camera, seen: LineObservations) -> Array:
    """Return the Cramer-Rao bound on the covariance of (x, y, phi), (3, 3), at the true pose.

    For Gaussian errors with the observations' standard deviations; the camera's deviations are estimated along,
    with their priors (van Trees' bound). A direction that nothing constrains has a variance of 1e4.
    """
    state = np.zeros(STATES)
    state[:3] = pose.as_array()
    _, jacobian = distances_and_jacobian(state, camera, seen)
    middle = 0.5 * (jacobian[:, 0] + jacobian[:, 1]) / seen.sigma_middle_px[:, None]
    slope = 0.5 * (jacobian[:, 1] - jacobian[:, 0]) / seen.sigma_slope_px[:, None]
    information = (
        middle.T @ middle + slope.T @ slope + np.diag(np.r_[0.0, 0.0, 0.0, nuisance_information(camera)])
    )
    return covariance_of(information)[:3, :3]


def nuisance_information(camera: Camera) -> Array:
    """Return the inverse variances (7,) of the priors on the camera's deviations."""
    mount = camera.mount
    std = [mount.std_height_m, mount.std_pitch_down_rad, mount.std_roll_rad, mount.std_yaw_rad]
    std += [camera.std_focal, camera.std_centre_px, camera.std_centre_px]
    result: Array = np.maximum(std, 1e-6) ** -2.0
    return result


def student_log_density(distance: Array, sigma: Array, student: float = STUDENT) -> Array:
    """Return the log density of distances under the estimator's noise, scaled by sigma; any shape."""
    peak = math.lgamma(0.5 * (student + 1.0)) - math.lgamma(0.5 * student)
    peak -= 0.5 * math.log(math.pi * student)
    tail: Array = peak - np.log(sigma) - 0.5 * (student + 1.0) * np.log1p((distance / sigma) ** 2 / student)
    return tail


def _mount(camera: Camera) -> Array:
    """The mount as the compiled code takes it."""
    mount = camera.mount
    return np.array(
        [mount.x_m, mount.y_m, mount.height_m, mount.pitch_down_rad, mount.roll_rad, mount.yaw_rad]
    )
