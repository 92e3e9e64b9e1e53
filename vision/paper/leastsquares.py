"""The pose of a hypothesis: least squares on equations (1.a) and (1.b) (section 3.3, after Phong and Horaud).

Unit directions, middles of the segments, and weight 1 for both equations, though one is a sine and the other is
in metres: the paper does not say otherwise. Levenberg-Marquardt over the camera's heading psi and plan position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import heading_terms, segment_lines
from vision.paper.errors import LineErrors

Rows = NDArray[np.int64]

_MAX_STEPS = 25
#: A step that lowers the cost by less than this share is the last.
_SETTLED = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Equations (1) of P pairs, with what does not depend on the pose computed.

    `terms`: (P, 8) a, b, c of (2.a), then n_x, n_y, n_z (p_z - z), p_x, p_y.
    """

    terms: Array


def equations(camera: Camera, wire_map: WireMap, errors: LineErrors, rows: Rows, lines: Rows) -> Equations:
    """Set up the equations of pairs of a map segment and an image line, (P,) each."""
    direction, points = segment_lines(wire_map, rows)
    normals = errors.normals[lines]
    a, b, c = heading_terms(normals, direction)
    drop = normals[:, 2] * (points[:, 2] - camera.mount.height_m)
    return Equations(np.column_stack([a, b, c, normals[:, :2], drop, points[:, :2]]))


def residuals_and_jacobian(state: Array, system: Equations) -> tuple[Array, Array]:
    """Return (1.a) and (1.b) of each pair, (P, 2), and their derivatives by (psi, x, y), (P, 2, 3)."""
    residuals, slopes = np.empty((len(system.terms), 2)), np.zeros((len(system.terms), 2, 3))
    for row, terms in enumerate(system.terms):
        values = _linearise(terms, math.cos(state[0]), math.sin(state[0]), state[1], state[2])
        residuals[row] = values[:2]
        slopes[row] = [[values[2], 0.0, 0.0], [values[3], values[4], values[5]]]
    return residuals, slopes


@njit(cache=True, nogil=True)
def _linearise(
    terms: Array, cos: float, sin: float, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    """(1.a), (1.b), their derivatives by psi, and those of (1.b) by x and y, at a pose."""
    dx, dy = terms[6] - x, terms[7] - y
    a = terms[3] * dx + terms[4] * dy
    b = terms[3] * dy - terms[4] * dx
    return (
        terms[0] * cos + terms[1] * sin + terms[2],
        a * cos + b * sin + terms[5],
        terms[1] * cos - terms[0] * sin,
        b * cos - a * sin,
        terms[4] * sin - terms[3] * cos,
        -terms[3] * sin - terms[4] * cos,
    )


@njit(cache=True, nogil=True)
def solve_pose(terms: Array, psi: float, x: float, y: float) -> tuple[float, float, float, float]:
    """Return the least cost near a start, and psi, x, y there. `terms`: (K, 8) as in `Equations`."""
    normal, gradient = np.empty((3, 3)), np.empty(3)
    normal_there, gradient_there = np.empty((3, 3)), np.empty(3)
    cost = _normal_equations(terms, psi, x, y, normal, gradient)
    damping = 1e-3
    for _ in range(_MAX_STEPS):
        ok, d0, d1, d2 = _damped_step(normal, gradient, damping)
        if not ok:
            break
        trial = _normal_equations(terms, psi + d0, x + d1, y + d2, normal_there, gradient_there)
        if trial <= cost:
            settled = cost - trial <= _SETTLED * cost + 1e-18
            psi, x, y, cost = psi + d0, x + d1, y + d2, trial
            normal, normal_there = normal_there, normal
            gradient, gradient_there = gradient_there, gradient
            damping = max(0.1 * damping, 1e-9)
            if settled:
                break
        else:
            damping *= 10.0
            if damping > 1e9:
                break
    return cost, psi, x, y


@njit(cache=True, nogil=True)
def best_position(terms: Array, psi: float, x: float, y: float) -> tuple[float, float]:
    """Return the position that fits best at a heading; (1.b) is linear in it. Near (x, y) where it is free."""
    normal, gradient = np.empty((3, 3)), np.empty(3)
    _normal_equations(terms, psi, x, y, normal, gradient)
    p, q, r = normal[1, 1] + 1e-9, normal[1, 2], normal[2, 2] + 1e-9
    det = p * r - q * q
    if det < 1e-12:
        return x, y
    dx = -(r * gradient[1] - q * gradient[2]) / det
    dy = -(p * gradient[2] - q * gradient[1]) / det
    return x + dx, y + dy


@njit(cache=True, nogil=True)
def _normal_equations(terms: Array, psi: float, x: float, y: float, normal: Array, gradient: Array) -> float:
    """Fill the normal matrix (3, 3) and the gradient (3,); return the cost."""
    cos, sin, total = math.cos(psi), math.sin(psi), 0.0
    n00 = n01 = n02 = n11 = n12 = n22 = g0 = g1 = g2 = 0.0
    for row in range(len(terms)):
        first, second, turn, s0, s1, s2 = _linearise(terms[row], cos, sin, x, y)
        total += first * first + second * second
        n00 += turn * turn + s0 * s0
        n01 += s0 * s1
        n02 += s0 * s2
        n11 += s1 * s1
        n12 += s1 * s2
        n22 += s2 * s2
        g0 += turn * first + s0 * second
        g1 += s1 * second
        g2 += s2 * second
    normal[0, 0], normal[1, 1], normal[2, 2] = n00, n11, n22
    normal[0, 1] = normal[1, 0] = n01
    normal[0, 2] = normal[2, 0] = n02
    normal[1, 2] = normal[2, 1] = n12
    gradient[0], gradient[1], gradient[2] = g0, g1, g2
    return total


@njit(cache=True, nogil=True)
def _damped_step(normal: Array, gradient: Array, damping: float) -> tuple[bool, float, float, float]:
    """Solve (N + damping diag N) d = -g by cofactors; false where it is singular."""
    a = normal[0, 0] * (1.0 + damping) + 1e-12
    d = normal[1, 1] * (1.0 + damping) + 1e-12
    f = normal[2, 2] * (1.0 + damping) + 1e-12
    b, c, e = normal[0, 1], normal[0, 2], normal[1, 2]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * c00 + b * c01 + c * c02
    if not det > 1e-30:
        return False, 0.0, 0.0, 0.0
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    g0, g1, g2 = gradient[0], gradient[1], gradient[2]
    return (
        True,
        -(c00 * g0 + c01 * g1 + c02 * g2) / det,
        -(c01 * g0 + c11 * g1 + c12 * g2) / det,
        -(c02 * g0 + c12 * g1 + c22 * g2) / det,
    )
