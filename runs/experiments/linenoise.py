"""The noise of table 1 on image segments, and how well it leaves them known.

An image line is n . q = d with n its unit normal, q ideal pixels from the principal point. Noise turns n by
delta ~ N(0, 1 deg) about the principal point and moves d by N(0, 3 px): at the foot of the principal point,
offset and direction err independently. Before that, calibration moves every point to (1 + e_m) q + e_a, with
one draw an image, or one a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maps.poses import Array
from runs.experiments.cases import STD_ANGLE_RAD, STD_CENTRE_PX, STD_OFFSET_PX, STD_SCALE, Case
from vision.lines import ImageSegments

#: Nothing is stated as known better than this share of table 1, not even what is exact.
_LEAST_NOISE = 0.01
#: Contrast of a drawn line in grey levels; nobody measures it.
_CONTRAST = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class LineDeviations:
    """Standard deviations of M lines: offset at the pivot [px], direction [rad], and where the pivot is.

    `pivot_px`: (M,) from the segment's middle towards its second end.
    """

    offset_px: Array
    angle_rad: Array
    pivot_px: Array


def stated_noise(case: Case) -> float:
    """Return the factor on table 1 that methods are told."""
    return max(case.noise, _LEAST_NOISE)


def disturbed(ends: Array, case: Case, rng: np.random.Generator) -> Array:
    """Return segments (M, 2, 2) in ideal pixels with calibration and line noise; the ends follow the line."""
    scale, shift, turns, moves = (
        rng.standard_normal(shape) for shape in ((len(ends), 2, 1), ends.shape, len(ends), len(ends))
    )
    if not case.per_point:
        # The same draws for an image of any number of lines.
        scale, shift = scale[:1, :1], shift[:1, :1]
    moved = (1.0 + case.noise * STD_SCALE * scale) * ends + case.noise * STD_CENTRE_PX * shift
    direction = moved[:, 1] - moved[:, 0]
    angle = np.arctan2(direction[:, 0], -direction[:, 1])
    offset = (np.column_stack([np.cos(angle), np.sin(angle)]) * moved[:, 0]).sum(axis=1)
    angle = angle + case.noise * STD_ANGLE_RAD * turns
    offset = offset + case.noise * STD_OFFSET_PX * moves
    normal = np.column_stack([np.cos(angle), np.sin(angle)])[:, None, :]
    beside = (normal * moved).sum(axis=2, keepdims=True) - offset[:, None, None]
    result: Array = moved - beside * normal
    return result


def deviations(ends: Array, case: Case) -> LineDeviations:
    """Return how well segments (M, 2, 2) with the case's noise are known.

    Point noise of deviation s at both ends adds an offset of s / sqrt(2) and a direction of s sqrt(2) / length
    at the middle. The sum of both noises has its independent offset and direction at a pivot between the two.
    """
    factor = stated_noise(case)
    middle = ends.mean(axis=1)
    span = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.linalg.norm(span, axis=1), 1e-9)
    along = span / length[:, None]
    foot = -(middle * along).sum(axis=1)
    angle_var = np.full(len(ends), (factor * STD_ANGLE_RAD) ** 2)
    offset_var = np.full(len(ends), (factor * STD_OFFSET_PX) ** 2)
    if not case.per_point:
        return LineDeviations(np.sqrt(offset_var), np.sqrt(angle_var), foot)
    distance = middle[:, 0] * along[:, 1] - middle[:, 1] * along[:, 0]
    point_var = factor**2 * ((STD_SCALE * distance) ** 2 + STD_CENTRE_PX**2)
    slope_var = 2.0 * point_var / length**2
    total = angle_var + slope_var
    apart = foot**2 * angle_var * slope_var / total
    return LineDeviations(
        np.sqrt(offset_var + 0.5 * point_var + apart), np.sqrt(total), foot * angle_var / total
    )


def image_segments(ends: Array, centre_px: tuple[float, float], case: Case) -> ImageSegments:
    """Return drawn segments (M, 2, 2), ideal pixels, as an extractor would hand them on."""
    known = deviations(ends, case)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    lever = 0.25 * length**2 + known.pivot_px**2
    return ImageSegments(
        raw_px=ends + centre_px,
        ideal_px=ends,
        sigma_px=np.sqrt(known.offset_px**2 + lever * known.angle_rad**2),
        sigma_middle_px=known.offset_px,
        sigma_angle_rad=known.angle_rad,
        polarity=np.zeros(len(ends)),
        contrast=np.full(len(ends), _CONTRAST),
        pivot_px=known.pivot_px,
    )
