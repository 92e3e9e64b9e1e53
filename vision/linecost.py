"""Distances of image lines from map segments, their derivatives, and the search for the likeliest state.

The compiled part of `vision.pose`, which states the equations. A mount is (x, y, height, pitch, roll, yaw), a
state (10,) x, y, phi and the deviations of height, pitch, roll, yaw, focal length and principal point.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.poses import Array

STATES = 10
#: Below this the cost has settled.
_SETTLED = 1e-4
#: A direction that nothing constrains must show as a long axis, not as a crash.
_LEAST_INFORMATION = 1e-4
#: Median absolute deviation of a normal distribution.
_NORMAL_MAD = 0.6745
#: Of a line that fixes the pose almost alone nothing but this share of its variance is left to be seen.
_LEAST_LEFT = 0.1


@njit(cache=True, nogil=True)
def linearise(
    state: Array,
    mount: Array,
    moments: Array,
    directions: Array,
    rays: Array,
    distances: Array,
    jacobian: Array,
) -> None:
    """Fill in the distances (K, 2) of two points on each line, and their derivatives (K, 2, 10)."""
    psi = state[2] + mount[5] + state[6]
    pitch, roll = mount[3] + state[4], mount[4] + state[5]
    cos, sin = math.cos(psi), math.sin(psi)
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    # Optical axes in the map frame: Rz(psi) Ry(pitch) Rx(roll) of the level camera's -y, -z and x.
    right = np.array([-(cos * sp * sr - sin * cr), -(sin * sp * sr + cos * cr), -(cp * sr)])
    down = np.array([-(cos * sp * cr + sin * sr), -(sin * sp * cr - cos * sr), -(cp * cr)])
    forward = np.array([cos * cp, sin * cp, -sp])
    level_x, level_y = cos, sin
    lever_x = math.cos(state[2]) * mount[0] - math.sin(state[2]) * mount[1]
    lever_y = math.sin(state[2]) * mount[0] + math.cos(state[2]) * mount[1]
    cx, cy, cz = state[0] + lever_x, state[1] + lever_y, mount[2] + state[3]
    slopes = np.zeros((STATES, 3))
    for k in range(len(rays)):
        vx, vy, vz = directions[k, 0], directions[k, 1], directions[k, 2]
        # N = p x v - T x v; it changes by v x dT where the centre moves, by N x w where the camera turns about w.
        nx = moments[k, 0] - (cy * vz - cz * vy)
        ny = moments[k, 1] - (cz * vx - cx * vz)
        nz = moments[k, 2] - (cx * vy - cy * vx)
        _turn(slopes, 0, 0.0, vz, -vy, right, down, forward)
        _turn(slopes, 1, -vz, 0.0, vx, right, down, forward)
        lx, ly = -lever_y, lever_x
        _turn(slopes, 2, ny - vz * ly, vz * lx - nx, vx * ly - vy * lx, right, down, forward)
        _turn(slopes, 3, vy, -vx, 0.0, right, down, forward)
        _turn(slopes, 4, -nz * level_x, -nz * level_y, nx * level_x + ny * level_y, right, down, forward)
        fx, fy, fz = forward[0], forward[1], forward[2]
        _turn(slopes, 5, ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx, right, down, forward)
        _turn(slopes, 6, ny, -nx, 0.0, right, down, forward)
        a = nx * right[0] + ny * right[1] + nz * right[2]
        b = nx * down[0] + ny * down[1] + nz * down[2]
        c = nx * forward[0] + ny * forward[1] + nz * forward[2]
        scale = 1.0 / max(math.sqrt(a * a + b * b), 1e-12)
        a, b, c = a * scale, b * scale, c * scale
        for end in range(2):
            u, v = rays[k, end, 0] - state[8], rays[k, end, 1] - state[9]
            focal = rays[k, end, 2]
            w = focal * (1.0 + state[7])
            distance = a * u + b * v + c * w
            distances[k, end] = distance
            for i in range(7):
                across = a * slopes[i, 0] + b * slopes[i, 1]
                moved = slopes[i, 0] * u + slopes[i, 1] * v + slopes[i, 2] * w
                jacobian[k, end, i] = scale * (moved - distance * across)
            jacobian[k, end, 7] = c * focal
            jacobian[k, end, 8] = -a
            jacobian[k, end, 9] = -b


@njit(cache=True, nogil=True)
def _turn(
    slopes: Array, row: int, x: float, y: float, z: float, right: Array, down: Array, forward: Array
) -> None:
    """Write a vector of the map frame into a row, in the optical frame."""
    slopes[row, 0] = x * right[0] + y * right[1] + z * right[2]
    slopes[row, 1] = x * down[0] + y * down[1] + z * down[2]
    slopes[row, 2] = x * forward[0] + y * forward[1] + z * forward[2]


@njit(cache=True, nogil=True)
def maximise(
    state: Array,
    mount: Array,
    prior: Array,
    moments: Array,
    directions: Array,
    rays: Array,
    sigma_middle: Array,
    sigma_slope: Array,
    credence: Array,
    student: float,
    max_iterations: int,
) -> tuple[Array, Array, float]:
    """Levenberg-Marquardt from a state; `prior`: (7,) inverse variances of the camera's deviations.

    Returns the state (10,), its covariance (10, 10), and the spread of the lines' middles over their deviations.
    """
    count = len(rays)
    distances, jacobian = np.empty((count, 2)), np.empty((count, 2, STATES))
    gradient, information = np.empty(STATES), np.empty((STATES, STATES))
    trial_gradient, trial_information = np.empty(STATES), np.empty((STATES, STATES))
    linearise(state, mount, moments, directions, rays, distances, jacobian)
    cost = _normal_equations(
        state, prior, distances, jacobian, sigma_middle, sigma_slope, credence, student, gradient, information
    )
    damping = 1e-4
    for _ in range(max_iterations):
        ridge = information.copy()
        for i in range(STATES):
            ridge[i, i] += damping * max(information[i, i], 1e-9)
        trial = state - np.linalg.solve(ridge, gradient)
        linearise(trial, mount, moments, directions, rays, distances, jacobian)
        trial_cost = _normal_equations(
            trial,
            prior,
            distances,
            jacobian,
            sigma_middle,
            sigma_slope,
            credence,
            student,
            trial_gradient,
            trial_information,
        )
        if trial_cost <= cost:
            settled = cost - trial_cost < _SETTLED
            state, cost = trial, trial_cost
            gradient, trial_gradient = trial_gradient, gradient
            information, trial_information = trial_information, information
            damping = max(0.1 * damping, 1e-9)
            if settled:
                break
        else:
            damping *= 10.0
    linearise(state, mount, moments, directions, rays, distances, jacobian)
    covariance = covariance_of(information)
    return state, covariance, _spread(distances, jacobian, sigma_middle, covariance)


@njit(cache=True, nogil=True)
def _spread(distances: Array, jacobian: Array, sigma_middle: Array, covariance: Array) -> float:
    """Median deviation of the lines' middles over that expected, of a normal distribution; 1 without lines.

    The fit itself takes a share of each residual, the leverage of its line.
    """
    count = len(distances)
    if count == 0:
        return 1.0
    residuals = np.empty(count)
    for k in range(count):
        row = 0.5 * (jacobian[k, 0] + jacobian[k, 1]) / sigma_middle[k]
        left = max(1.0 - _product(row, covariance, row), _LEAST_LEFT)
        residuals[k] = abs(0.5 * (distances[k, 0] + distances[k, 1])) / (sigma_middle[k] * math.sqrt(left))
    return np.median(residuals) / _NORMAL_MAD


@njit(cache=True, nogil=True)
def shifts(
    state: Array, covariance: Array, mount: Array, moments: Array, directions: Array, rays: Array
) -> Array:
    """How far a state's uncertainty may shift each line at the worse of its two points, one deviation, (K,)."""
    count = len(rays)
    distances, jacobian = np.empty((count, 2)), np.empty((count, 2, STATES))
    linearise(state, mount, moments, directions, rays, distances, jacobian)
    result = np.empty(count)
    for k in range(count):
        first = _product(jacobian[k, 0], covariance, jacobian[k, 0])
        second = _product(jacobian[k, 1], covariance, jacobian[k, 1])
        result[k] = math.sqrt(max(first, second, 0.0))
    return result


@njit(cache=True, nogil=True)
def innovations(
    state: Array,
    covariance: Array,
    mount: Array,
    moments: Array,
    directions: Array,
    rays: Array,
    sigma_middle: Array,
    sigma_slope: Array,
) -> Array:
    """Normalised squared innovations (K,) of offset and slope, against noise and the state's uncertainty."""
    count = len(rays)
    distances, jacobian = np.empty((count, 2)), np.empty((count, 2, STATES))
    linearise(state, mount, moments, directions, rays, distances, jacobian)
    result = np.empty(count)
    for k in range(count):
        offset, turn = 0.5 * (distances[k, 0] + distances[k, 1]), 0.5 * (distances[k, 1] - distances[k, 0])
        middle, slope = 0.5 * (jacobian[k, 0] + jacobian[k, 1]), 0.5 * (jacobian[k, 1] - jacobian[k, 0])
        a = _product(middle, covariance, middle) + sigma_middle[k] ** 2
        b = _product(middle, covariance, slope)
        c = _product(slope, covariance, slope) + sigma_slope[k] ** 2
        result[k] = (c * offset * offset - 2.0 * b * offset * turn + a * turn * turn) / (a * c - b * b)
    return result


@njit(cache=True, nogil=True)
def _product(left: Array, matrix: Array, right: Array) -> float:
    """left . matrix . right, of vectors (10,)."""
    total = 0.0
    for i in range(STATES):
        row = 0.0
        for j in range(STATES):
            row += matrix[i, j] * right[j]
        total += left[i] * row
    return total


@njit(cache=True, nogil=True)
def covariance_of(information: Array) -> Array:
    """The inverse of an information (10, 10); what nothing constrains has a variance of 1e4 instead of none."""
    bounded = information.copy()
    for i in range(3):
        bounded[i, i] += _LEAST_INFORMATION
    covariance = np.linalg.inv(bounded)
    return 0.5 * (covariance + covariance.T)


@njit(cache=True, nogil=True)
def _normal_equations(
    state: Array,
    prior: Array,
    distances: Array,
    jacobian: Array,
    sigma_middle: Array,
    sigma_slope: Array,
    credence: Array,
    student: float,
    gradient: Array,
    information: Array,
) -> float:
    """The negative log likelihood, up to a constant; fills in its gradient and its expected curvature."""
    gradient[:] = 0.0
    information[:] = 0.0
    cost = 0.0
    for i in range(7):
        gradient[3 + i] = prior[i] * state[3 + i]
        information[3 + i, 3 + i] = prior[i]
        cost += 0.5 * prior[i] * state[3 + i] ** 2
    row = np.empty(STATES)
    for k in range(len(distances)):
        for part in range(2):
            sign = 1.0 if part == 0 else -1.0
            over = 0.5 / (sigma_middle[k] if part == 0 else sigma_slope[k])
            residual = (distances[k, 1] + sign * distances[k, 0]) * over
            weight = credence[k] * (student + 1.0) / (student + residual * residual)
            cost += 0.5 * credence[k] * (student + 1.0) * math.log1p(residual * residual / student)
            for i in range(STATES):
                row[i] = (jacobian[k, 1, i] + sign * jacobian[k, 0, i]) * over
            for i in range(STATES):
                gradient[i] += weight * residual * row[i]
                for j in range(i + 1):
                    information[i, j] += weight * row[i] * row[j]
    for i in range(STATES):
        for j in range(i):
            information[j, i] = information[i, j]
    return cost
