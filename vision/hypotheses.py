"""Pose hypotheses from couples of correspondences, in closed form, and from a grid over the window.

Given a heading, every correspondence confines the camera to a line of the plan (equation 2.b), so a
non-vertical pair, which brings the heading, and one more pair give a pose. Right couples agree with each
other and wrong ones scatter: couples vote in cells of (x, y, phi), and the fullest cells become hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array, wrap_angle
from vision.camera import Camera
from vision.constraints import Correspondences, position_lines


@dataclass(frozen=True, slots=True)
class HypothesisConfig:
    """How many hypotheses, and how coarse."""

    #: Couples tried; above this a reproducible sample of them.
    max_couples: int = 60_000
    #: Position lines that cross at a smaller angle fix the position too badly.
    min_crossing_rad: float = 0.2
    #: Two non-vertical pairs must agree on the heading to this.
    heading_agreement_rad: float = 0.02
    #: Size of a voting cell.
    cell_m: float = 0.06
    cell_rad: float = 0.012
    #: The fullest cells that become hypotheses.
    max_from_couples: int = 250
    #: Steps of the grid from the centre to the edge of the window, per dimension.
    grid_steps: int = 3


def couple_hypotheses(
    camera: Camera, pairs: Correspondences, window: SearchWindow, config: HypothesisConfig
) -> Array:
    """Return poses (H, 3) as (x, y, phi) that couples of correspondences agree on, most votes first."""
    first, second = _couples(pairs, config)
    phi = _agreed_heading(pairs, first, second, config)
    known = np.isfinite(phi)
    first, second, phi = first[known], second[known], phi[known]
    line_a, offset_a = position_lines(camera, pairs.normals_level[first], pairs.points[first], phi)
    line_b, offset_b = position_lines(camera, pairs.normals_level[second], pairs.points[second], phi)
    crossing = line_a[:, 0] * line_b[:, 1] - line_a[:, 1] * line_b[:, 0]
    crosses = np.abs(crossing) > np.sin(config.min_crossing_rad)
    crossing = np.where(crosses, crossing, 1.0)
    x = (offset_a * line_b[:, 1] - offset_b * line_a[:, 1]) / crossing
    y = (offset_b * line_a[:, 0] - offset_a * line_b[:, 0]) / crossing
    lever = camera.mount.x_m + 1j * camera.mount.y_m
    robot = (x + 1j * y) - lever * np.exp(1j * phi)
    poses = np.column_stack([robot.real, robot.imag, phi])[crosses]
    return _fullest_cells(poses[_inside(poses, window)], window, config)


def grid_hypotheses(window: SearchWindow, config: HypothesisConfig) -> Array:
    """Return poses (H, 3) on a regular grid over the window, its centre among them."""
    steps = np.linspace(-1.0, 1.0, 2 * config.grid_steps + 1)
    dx, dy, dphi = (axis.ravel() for axis in np.meshgrid(steps, steps, steps, indexing="ij"))
    inside = np.hypot(dx, dy) <= 1.0 + 1e-9
    offsets = np.column_stack([dx * window.dt_m, dy * window.dt_m, dphi * window.dphi_rad])[inside]
    result: Array = window.centre.as_array() + offsets
    return result


def _couples(pairs: Correspondences, config: HypothesisConfig) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of couples that use two segments, two lines, and at least one heading."""
    with_heading = np.flatnonzero(np.isfinite(pairs.phi))
    count = len(with_heading) * len(pairs)
    if count > config.max_couples:
        rng = np.random.default_rng(count)  # the same couples for the same image: runs repeat bit for bit
        chosen = rng.choice(count, config.max_couples, replace=False)
    else:
        chosen = np.arange(count)
    first, second = with_heading[chosen // len(pairs)], chosen % len(pairs)
    useful = (pairs.rows[first] != pairs.rows[second]) & (pairs.lines[first] != pairs.lines[second])
    return first[useful], second[useful]


def _agreed_heading(
    pairs: Correspondences, first: NDArray[np.int64], second: NDArray[np.int64], config: HypothesisConfig
) -> Array:
    """The couples' headings (K,): the mean where both have one and agree; NaN where they disagree."""
    gap = wrap_angle(pairs.phi[second] - pairs.phi[first])
    mean = wrap_angle(pairs.phi[first] + 0.5 * np.nan_to_num(gap))
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(gap) > config.heading_agreement_rad, np.nan, mean)


def _inside(poses: Array, window: SearchWindow) -> NDArray[np.bool_]:
    away = poses - window.centre.as_array()
    near = np.hypot(away[:, 0], away[:, 1]) <= window.dt_m
    result: NDArray[np.bool_] = near & (np.abs(wrap_angle(away[:, 2])) <= window.dphi_rad)
    return result


def _fullest_cells(poses: Array, window: SearchWindow, config: HypothesisConfig) -> Array:
    """The mean pose of each of the fullest voting cells, most votes first."""
    if not len(poses):
        return poses
    away = poses - window.centre.as_array()
    away[:, 2] = wrap_angle(away[:, 2])
    cells = np.floor(away / [config.cell_m, config.cell_m, config.cell_rad]).astype(np.int64)
    _, cell, votes = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()
    means = np.column_stack([np.bincount(cell, away[:, axis]) / votes for axis in range(3)])
    order = np.argsort(-votes, kind="stable")[: config.max_from_couples]
    result: Array = means[order] + window.centre.as_array()
    return result
