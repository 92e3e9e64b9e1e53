"""Pose hypotheses from couples of correspondences, in closed form, and from a grid over the window.

Given a heading, every correspondence confines the camera to a line of the plan (equation 2.b), so a
non-vertical pair, which brings the heading, and one more pair give a pose. Right couples agree with each
other and wrong ones scatter: couples vote in cells of (x, y, phi), and the fullest cells become hypotheses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array
from vision.camera import Camera
from vision.constraints import Correspondences


@dataclass(frozen=True, slots=True)
class HypothesisConfig:
    """How many hypotheses, and how coarse."""

    #: The longest lines form couples; the short ones among many are mostly clutter.
    max_lines: int = 100
    #: Couples tried; above this an even sample of them.
    max_couples: int = 20_000
    #: Position lines that cross at a smaller angle fix the position too badly.
    min_crossing_rad: float = 0.2
    #: Two non-vertical pairs must agree on the heading to this.
    heading_agreement_rad: float = 0.02
    #: Size of a voting cell.
    cell_m: float = 0.06
    cell_rad: float = 0.012
    #: The fullest cells that become hypotheses.
    max_from_couples: int = 250
    #: Steps of the grid over the window.
    grid_m: float = 0.15
    grid_rad: float = 0.03


def couple_hypotheses(
    camera: Camera, pairs: Correspondences, window: SearchWindow, config: HypothesisConfig
) -> Array:
    """Return poses (H, 3) as (x, y, phi) that couples of correspondences agree on, most votes first."""
    half = np.array([window.dt_m, window.dt_m, window.dphi_rad])
    size = np.array([config.cell_m, config.cell_m, config.cell_rad])
    shape = np.ceil(2.0 * half / size).astype(np.int64) + 1
    votes, sums = _vote(
        pairs.rows,
        pairs.lines,
        pairs.phi,
        pairs.normals_level,
        pairs.points,
        np.array([camera.mount.x_m, camera.mount.y_m, camera.mount.height_m, camera.mount.yaw_rad]),
        window.centre.as_array(),
        half,
        size,
        shape,
        config.max_couples,
        config.heading_agreement_rad,
        math.sin(config.min_crossing_rad),
        *_bound(window),
    )
    full = np.flatnonzero(votes)
    full = full[np.argsort(-votes[full], kind="stable")[: config.max_from_couples]]
    result: Array = window.centre.as_array() + sums[full] / votes[full, None]
    return result


def grid_hypotheses(window: SearchWindow, config: HypothesisConfig) -> Array:
    """Return poses (H, 3) on a regular grid over the window, its centre among them."""
    dt_m, dphi_rad = window.dt_m, window.dphi_rad
    across = np.linspace(-dt_m, dt_m, 2 * math.ceil(dt_m / config.grid_m) + 1)
    around = np.linspace(-dphi_rad, dphi_rad, 2 * math.ceil(dphi_rad / config.grid_rad) + 1)
    offsets = np.stack(np.meshgrid(across, across, around, indexing="ij"), axis=3).reshape(-1, 3)
    inside = np.hypot(offsets[:, 0], offsets[:, 1]) <= dt_m * (1.0 + 1e-9)
    result: Array = window.centre.as_array() + offsets[inside]
    if window.ellipsoid is None:
        return result
    # A pose at the rim may have its node outside, half a step away.
    half = 0.5 * np.array([config.grid_m, config.grid_m, config.grid_rad])
    return result[window.ellipsoid.widened(half).holds(result)]


@njit(cache=True, nogil=True)
def spaced(poses: Array, number: int, apart_m: float, apart_rad: float) -> NDArray[np.int64]:
    """Return up to `number` rows of poses (H, 3), from the first on, each at some distance from all before."""
    chosen = np.empty(number, np.int64)
    count = 0
    for row in range(len(poses)):
        if count == number:
            break
        free = True
        for at in range(count):
            x, y, phi = poses[chosen[at]] - poses[row]
            if x * x + y * y < apart_m * apart_m and abs(_wrapped(phi)) < apart_rad:
                free = False
                break
        if free:
            chosen[count] = row
            count += 1
    return chosen[:count]


def _bound(window: SearchWindow) -> tuple[Array, Array]:
    """What offsets from a window's centre must keep to: less the first (3,), under the second (3, 3), at most one."""
    if window.ellipsoid is None:
        return np.zeros(3), np.zeros((3, 3))
    # The slices of a wide window share its ellipsoid, which is not centred on them.
    return window.ellipsoid.centre.minus(window.centre), window.ellipsoid.matrix


@njit(cache=True, nogil=True)
def _vote(
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    headings: Array,
    normals: Array,
    points: Array,
    mount: Array,
    centre: Array,
    half: Array,
    size: Array,
    shape: NDArray[np.int64],
    max_couples: int,
    agreement_rad: float,
    min_crossing: float,
    bound_centre: Array,
    bound: Array,
) -> tuple[NDArray[np.int64], Array]:
    """Solve couples of correspondences; count the poses in each cell (C,), and sum their offsets (C, 3)."""
    votes, sums = np.zeros(shape.prod(), np.int64), np.zeros((shape.prod(), 3))
    with_heading = np.flatnonzero(np.isfinite(headings))
    couples = len(with_heading) * len(rows)
    tried = min(couples, max_couples)
    for number in range(tried):
        couple = number * couples // tried
        first, second = with_heading[couple // len(rows)], couple % len(rows)
        if rows[first] == rows[second] or lines[first] == lines[second]:
            continue
        phi = headings[first]
        if math.isfinite(headings[second]):
            if second < first:
                continue  # the same couple, the other way round
            gap = _wrapped(headings[second] - phi)
            if abs(gap) > agreement_rad:
                continue
            phi += 0.5 * gap
        turned = _wrapped(phi - centre[2])
        if abs(turned) > half[2]:
            continue
        ax, ay, a = _position_line(normals[first], points[first], phi + mount[3], mount[2])
        bx, by, b = _position_line(normals[second], points[second], phi + mount[3], mount[2])
        crossing = ax * by - ay * bx
        if abs(crossing) < min_crossing:
            continue
        cos, sin = math.cos(phi), math.sin(phi)
        x = (a * by - b * ay) / crossing - (cos * mount[0] - sin * mount[1]) - centre[0]
        y = (b * ax - a * bx) / crossing - (sin * mount[0] + cos * mount[1]) - centre[1]
        if x * x + y * y > half[0] ** 2:
            continue
        dx, dy, turn = x - bound_centre[0], y - bound_centre[1], _wrapped(turned - bound_centre[2])
        square = bound[0, 0] * dx * dx + bound[1, 1] * dy * dy + bound[2, 2] * turn * turn
        square += 2.0 * (bound[0, 1] * dx * dy + bound[0, 2] * dx * turn + bound[1, 2] * dy * turn)
        if square > 1.0:
            continue
        cell = int((x + half[0]) / size[0]) * shape[1] + int((y + half[1]) / size[1])
        cell = cell * shape[2] + int((turned + half[2]) / size[2])
        votes[cell] += 1
        sums[cell, 0] += x
        sums[cell, 1] += y
        sums[cell, 2] += turned
    return votes, sums


@njit(cache=True, nogil=True)
def _position_line(normal: Array, point: Array, psi: float, height: float) -> tuple[float, float, float]:
    """Equation (2.b) of one pair, as in `vision.constraints.position_lines`: unit normal and offset."""
    cos, sin = math.cos(psi), math.sin(psi)
    x, y = cos * normal[0] - sin * normal[1], sin * normal[0] + cos * normal[1]
    scale = max(math.hypot(x, y), 1e-9)
    offset = x * point[0] + y * point[1] + normal[2] * (point[2] - height)
    return x / scale, y / scale, offset / scale


@njit(cache=True, nogil=True)
def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
