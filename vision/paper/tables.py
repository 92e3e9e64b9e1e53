"""Tolerances by Monte Carlo, made once and kept with the map (section 3.4).

For each model segment and a grid of synthetic image lines the paper samples the lines' errors and tabulates the
spread of what equations (2.a) and (2.b) give; the same for couples of vertical edges and the circle of equation
(4). Turning a segment about the vertical turns its answers and nothing else, so segments of one slope share a
table; a circle grows with its baseline, so couples share one for a baseline of one metre.

The paper tabulates A, B, C, whose scale depends on the units. Here it is the direction alpha of the position
line's normal and the rate tau at which height moves it, from which the spread of its distance to any point
follows: D = (cos alpha, sin alpha) . (p - e) + tau (z_p - z).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, wrap_angle
from vision.camera import Camera
from vision.constraints import heading_roots, heading_terms, level_from_optical
from vision.paper.selection import ViewedDisc

#: Smaller angles between two edges make circles too large to tell.
_LEAST_ANGLE_RAD = math.radians(0.2)


@dataclass(frozen=True, slots=True)
class TableConfig:
    """The noise and the grids of the tables. Calibration and tilt come with the camera."""

    #: Table 1: direction, and distance from the principal point.
    std_angle_rad: float = math.radians(1.0)
    std_distance_px: float = 3.0
    #: Synthetic lines: directions over half a turn, distances over the image; bearings over the view.
    angles: int = 60
    distances: int = 41
    bearings: int = 41
    #: Tables are made for tilts and segments' slopes rounded to this, since spreads change slowly.
    tilt_step_rad: float = math.radians(1.0)
    slope_step_rad: float = math.radians(5.0)
    samples: int = 200
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class ToleranceTable:
    """The spreads, and how to find them.

    `slopes`: (S,) rad, rising. `heading_std`: (S, 2, A, D) of each root; `line_covariance`: (S, 2, A, D, 3)
    variance of alpha, covariance of alpha and tau, variance of tau. `circle_covariance`: (B, B, 3) the same of
    the centre's distance from the baseline and of the radius, for bearings of the two edges from the one side
    of the view to the other. `reach_px`, `reach_rad`: where the grids of distances and bearings end.
    `optical_from_level`: (3, 3).
    """

    slopes: Array
    heading_std: Array
    line_covariance: Array
    circle_covariance: Array
    reach_px: float
    reach_rad: float
    focal_px: float
    optical_from_level: Array

    def fits(
        self, normals: Array, direction: Array, offset: Array, roots: Array, disc: ViewedDisc, sigmas: float
    ) -> NDArray[np.bool_]:
        """Return whether heading and position line of pairs fit the window within tabulated spreads, (C, 2).

        `normals`, `direction`: (C, 3); `offset`: (C, 3) from the disc's centre, at the camera's height, to the
        segments' middles; `roots`: (C, 2) headings by (2.a).
        """
        heading_std, covariance = self.spreads(normals, direction)
        fits = np.abs(wrap_angle(roots - disc.psi)) <= disc.dpsi + sigmas * heading_std
        steepness = np.maximum(np.hypot(normals[:, 0], normals[:, 1]), 1e-9)[:, None]
        alpha = roots + np.arctan2(normals[:, 1], normals[:, 0])[:, None]
        cos, sin = np.cos(alpha), np.sin(alpha)
        x, y, z = (offset[:, axis, None] for axis in range(3))
        distance = np.abs(cos * x + sin * y + normals[:, 2, None] / steepness * z)
        turn = cos * y - sin * x
        variance = (
            turn**2 * covariance[..., 0] + 2.0 * turn * z * covariance[..., 1] + z**2 * covariance[..., 2]
        )
        result: NDArray[np.bool_] = fits & (distance <= disc.radius_m + sigmas * np.sqrt(variance.clip(0.0)))
        return result

    def spreads(self, normals: Array, direction: Array) -> tuple[Array, Array]:
        """Return heading spreads (C, 2) and line covariances (C, 2, 3) at the nearest synthetic lines."""
        optical = normals @ self.optical_from_level.T
        flipped = optical[:, 1] < 0.0
        optical = np.where(flipped[:, None], -optical, optical)
        angle = np.arctan2(optical[:, 1], optical[:, 0]) % np.pi
        flat = np.maximum(np.hypot(optical[:, 0], optical[:, 1]), 1e-9)
        distance = -self.focal_px * optical[:, 2] / flat
        _, angles, distances = self.heading_std.shape[1:]
        at_angle = np.rint(angle / np.pi * angles).astype(np.int64)
        # Half a turn further the same line has its distance with the other sign, and its roots exchanged.
        over = at_angle == angles
        at_angle, distance = np.where(over, 0, at_angle), np.where(over, -distance, distance)
        step = 2.0 * self.reach_px / (distances - 1)
        at_distance = np.clip(np.rint((distance + self.reach_px) / step), 0, distances - 1).astype(np.int64)
        rise = np.arcsin(np.clip(direction[:, 2], -1.0, 1.0))
        at_slope = np.abs(self.slopes - np.abs(rise)[:, None]).argmin(axis=1)
        exchanged = flipped ^ over ^ (rise < 0.0)
        root = np.where(exchanged[:, None], [1, 0], [0, 1])
        where = (at_slope[:, None], root, at_angle[:, None], at_distance[:, None])
        covariance = self.line_covariance[where]
        # alpha and tau are those of the normal as it is given here.
        sign = np.where(flipped ^ over, -1.0, 1.0)[:, None]
        return self.heading_std[where], covariance * np.stack([sign**2, sign, sign**2], axis=2)


def build_table(camera: Camera, slopes: Array, half_view_rad: float, config: TableConfig) -> ToleranceTable:
    """Sample the errors of synthetic lines and of couples, for segments of these slopes (S,)."""
    rng = np.random.default_rng(config.seed)
    level = level_from_optical(camera)
    border = np.array([(u, v) for u in (0.0, camera.width - 1.0) for v in (0.0, camera.height - 1.0)])
    reach_px = float(camera.focal_px * np.linalg.norm(camera.undistort(border), axis=1).max())
    true, sampled = _synthetic_normals(camera, level, reach_px, config, rng)
    spreads = [_line_spreads(true, sampled, slope) for slope in slopes.tolist()]
    return ToleranceTable(
        slopes=slopes,
        heading_std=np.stack([spread[0] for spread in spreads]),
        line_covariance=np.stack([spread[1] for spread in spreads]),
        circle_covariance=_circle_spreads(camera, half_view_rad, config, rng),
        reach_px=reach_px,
        reach_rad=half_view_rad,
        focal_px=camera.focal_px,
        optical_from_level=level.T,
    )


def slopes_of(directions: Array, step_rad: float) -> Array:
    """Return the slopes of directions (K, 3), rounded, each once, vertical ones left out, (S,)."""
    rise = np.abs(np.arcsin(np.clip(directions[:, 2], -1.0, 1.0)))
    slopes: Array = np.unique(np.rint(rise / step_rad)) * step_rad
    slopes = slopes[slopes < 0.5 * np.pi - 0.5 * step_rad]
    return slopes if len(slopes) else np.zeros(1)


def _synthetic_normals(
    camera: Camera, level: Array, reach_px: float, config: TableConfig, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Level normals of the grid's lines, (A, D, 3), and of samples of them, (A, D, samples, 3)."""
    angle = (np.arange(config.angles) * np.pi / config.angles)[:, None, None]
    distance = np.linspace(-reach_px, reach_px, config.distances)[None, :, None]
    shape = (config.angles, config.distances, config.samples)
    noisy_angle = angle + config.std_angle_rad * rng.standard_normal(shape)
    noisy_distance = distance + config.std_distance_px * rng.standard_normal(shape)
    shift = camera.std_centre_px * rng.standard_normal((2, *shape))
    cos, sin = np.cos(noisy_angle), np.sin(noisy_angle)
    moved = noisy_distance + shift[0] * cos + shift[1] * sin
    focal = camera.focal_px * (1.0 + camera.std_focal * rng.standard_normal(shape))
    sampled = _unit(np.stack([cos, sin, -moved / focal], axis=3)) @ level.T
    mount = camera.mount
    turns = rng.standard_normal((2, *shape))
    pitch, roll = mount.std_pitch_down_rad * turns[0], mount.std_roll_rad * turns[1]
    axes = np.stack([roll, pitch, np.zeros(shape)], axis=3)
    sampled = _unit(sampled + np.cross(axes, sampled))
    whole = np.broadcast_arrays(np.cos(angle), np.sin(angle), -distance / camera.focal_px)
    return _unit(np.stack(whole, axis=3))[:, :, 0] @ level.T, sampled


def _line_spreads(true: Array, sampled: Array, slope: float) -> tuple[Array, Array]:
    """Spreads of (2.a) and (2.b) for segments of one slope: (2, A, D) and (2, A, D, 3)."""
    direction = np.array([math.cos(slope), 0.0, math.sin(slope)])
    headings, alphas, taus = (np.stack(parts) for parts in zip(*_answers(sampled, direction), strict=True))
    right = tuple(np.stack(parts)[..., None] for parts in zip(*_answers(true, direction), strict=True))
    off_heading, off_alpha = wrap_angle(headings - right[0]), wrap_angle(alphas - right[1])
    off_tau = taus - right[2]
    products = (off_alpha**2, off_alpha * off_tau, off_tau**2)
    covariance = np.stack([product.mean(axis=-1) for product in products], axis=-1)
    return np.sqrt((off_heading**2).mean(axis=-1)), covariance


def _answers(normals: Array, direction: Array) -> list[tuple[Array, Array, Array]]:
    """Heading, alpha and tau of both roots, (...) each."""
    a, b, c = heading_terms(normals, direction)
    middle, spread = heading_roots(a, b, c)
    own = np.arctan2(normals[..., 1], normals[..., 0])
    tau = normals[..., 2] / np.maximum(np.hypot(normals[..., 0], normals[..., 1]), 1e-3)
    return [(root, root + own, tau) for root in (middle + spread, middle - spread)]


def _circle_spreads(
    camera: Camera, half_view_rad: float, config: TableConfig, rng: np.random.Generator
) -> Array:
    """Spread of the circle over a baseline of one metre, for two bearings: (B, B, 3)."""
    bearing = np.linspace(-half_view_rad, half_view_rad, config.bearings)
    shape = (config.bearings, config.bearings, config.samples)
    focal = camera.focal_px * (1.0 + camera.std_focal * rng.standard_normal(shape))
    shift = camera.std_centre_px * rng.standard_normal(shape)
    # Bearings grow to the left, columns to the right; at the rim of a very wide view a pixel turns little.
    pixels = -camera.focal_px * np.tan(np.clip(bearing, -1.5, 1.5))
    first, second = np.meshgrid(pixels, pixels, indexing="ij")
    noisy = [
        column[..., None] + config.std_distance_px * rng.standard_normal(shape) for column in (first, second)
    ]
    seen = [np.arctan2(-(column - shift), focal) for column in noisy]
    true = bearing[:, None] - bearing[None]
    side = np.where(true < 0.0, -1.0, 1.0)
    angle = np.maximum((seen[0] - seen[1]) * side[..., None], _LEAST_ANGLE_RAD)
    true = np.maximum(np.abs(true), _LEAST_ANGLE_RAD)[..., None]
    off_centre, off_radius = (
        0.5 / np.tan(angle) - 0.5 / np.tan(true),
        0.5 / np.sin(angle) - 0.5 / np.sin(true),
    )
    products = (off_centre**2, off_centre * off_radius, off_radius**2)
    return np.stack([product.mean(axis=2) for product in products], axis=2)


def _unit(vectors: Array) -> Array:
    result: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return result
