"""Motion along a circular arc, with its derivatives (Thrun et al., Probabilistic Robotics, section 5.4).

An arc of length f that turns by w ends f sin(w/2)/(w/2) away, in the direction of the heading halfway.
A slip to the side, l, goes the same way, a quarter turn to the left. Compiled, as it runs at every step of
the odometry and again at every late fix.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.poses import Array


@njit(cache=True, nogil=True)
def _sinc(angle: float) -> float:
    return 1.0 - angle**2 / 6.0 if abs(angle) < 1e-4 else math.sin(angle) / angle


@njit(cache=True, nogil=True)
def _sinc_slope(angle: float) -> float:
    if abs(angle) < 1e-2:
        return -angle / 3.0 + angle**3 / 30.0 - angle**5 / 840.0
    return (angle * math.cos(angle) - math.sin(angle)) / angle**2


@njit(cache=True, nogil=True)
def displacement(phi: float, forward_m: float, turn_rad: float, sideways_m: float) -> tuple[float, float]:
    """Return how far (x, y) an arc goes that begins at heading `phi` [m, frame of phi]."""
    half = 0.5 * turn_rad
    cos, sin, ratio = math.cos(phi + half), math.sin(phi + half), _sinc(half)
    return ratio * (forward_m * cos - sideways_m * sin), ratio * (forward_m * sin + sideways_m * cos)


@njit(cache=True, nogil=True)
def by_motion(phi: float, forward_m: float, turn_rad: float, sideways_m: float) -> Array:
    """Return the derivative (3, 3) of (x, y, phi) at an arc's end by (forward, turn, sideways).

    That by the heading at its beginning is the displacement turned by a quarter, and needs no function.
    """
    half = 0.5 * turn_rad
    cos, sin = math.cos(phi + half), math.sin(phi + half)
    ratio, slope = _sinc(half), 0.5 * _sinc_slope(half)
    x, y = forward_m * cos - sideways_m * sin, forward_m * sin + sideways_m * cos
    return np.array(
        [
            [ratio * cos, slope * x - 0.5 * ratio * y, -ratio * sin],
            [ratio * sin, slope * y + 0.5 * ratio * x, ratio * cos],
            [0.0, 1.0, 0.0],
        ]
    )


@njit(cache=True, nogil=True)
def moved(
    mean: Array, motion: tuple[float, float], systematic: Array, random: Array, forgetting: float
) -> tuple[Array, Array, Array]:
    """Move a state along an arc: the new mean (n,), and F and Q, (n, n), of P = F P F' + Q.

    `mean`: x, y, phi, then the parameters p of the systematic errors. `motion`: forward and turn as measured;
    the arc driven is (forward, turn, 0) + `systematic` p. `random`: (3, 3), covariance of its random errors.
    The parameters fade by exp(-forgetting), and Q keeps their variance at one. phi is not wrapped.
    """
    size = len(mean)
    forward_m, turn_rad, sideways_m = motion[0], motion[1], 0.0
    for i in range(size - 3):
        forward_m += systematic[0, i] * mean[3 + i]
        turn_rad += systematic[1, i] * mean[3 + i]
        sideways_m += systematic[2, i] * mean[3 + i]
    x, y = displacement(mean[2], forward_m, turn_rad, sideways_m)
    slopes = by_motion(mean[2], forward_m, turn_rad, sideways_m)
    kept = math.exp(-forgetting)
    after, transition, noise = kept * mean, np.eye(size), np.zeros((size, size))
    after[0], after[1], after[2] = mean[0] + x, mean[1] + y, mean[2] + turn_rad
    transition[0, 2], transition[1, 2] = -y, x
    for i in range(3):
        for j in range(size - 3):
            for k in range(3):
                transition[i, 3 + j] += slopes[i, k] * systematic[k, j]
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    noise[i, j] += slopes[i, k] * random[k, m] * slopes[j, m]
    for i in range(3, size):
        transition[i, i], noise[i, i] = kept, 1.0 - kept * kept
    return after, transition, noise


@njit(cache=True, nogil=True)
def carried(slip: Array, transition: Array, share: float, noise: Array) -> Array:
    """Move a pose's covariance (3, 3) with the transition's pose block, and add a share of the noise's."""
    after = np.empty((3, 3))
    x, y = transition[1, 2], -transition[0, 2]
    levers = (-y, x, 0.0)
    # The transition adds the lever arm times the heading's error to x and y.
    for i in range(3):
        for j in range(3):
            moved_on = slip[i, j] + levers[i] * slip[2, j] + levers[j] * slip[i, 2]
            after[i, j] = moved_on + levers[i] * levers[j] * slip[2, 2] + share * noise[i, j]
    return after
