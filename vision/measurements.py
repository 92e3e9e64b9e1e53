"""Image lines as the estimator weighs them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from maps.poses import Array
from vision.lines import ImageSegments


@dataclass(frozen=True, slots=True, eq=False)
class LineMeasurements:
    """M image lines, each measured at two points about the place where its errors are independent.

    `rays`: (M, 2, 3) the two points as (u, v, f), ideal pixels, as far apart as the line is long.
    `sigma_middle_px`, `sigma_slope_px`: (M,) standard deviations of the half sum and of the half difference of
    the points' distances from a true line. `ends_px`: (M, 2, 2) and `lengths_px`: (M,) of the line itself.
    `along`: (M, 2) its unit direction, `polarity`: (M,) +1 brighter on the right looking along it, else -1.
    `typical_px`: median of `sigma_middle_px`.
    """

    rays: Array
    sigma_middle_px: Array
    sigma_slope_px: Array
    ends_px: Array
    lengths_px: Array
    along: Array
    polarity: Array
    typical_px: float = field(init=False)

    def __post_init__(self) -> None:
        middle = self.sigma_middle_px
        object.__setattr__(self, "typical_px", float(np.median(middle)) if len(middle) else 0.0)

    def __len__(self) -> int:
        return len(self.rays)


def measured_lines(segments: ImageSegments, focal_px: float, edge_model_px: float) -> LineMeasurements:
    """Weigh an image's segments.

    `edge_model_px`: what an end point of a real edge is off its straight, sharp ideal, beside the noise.
    """
    lengths = segments.lengths_px
    along = (segments.ideal_px[:, 1] - segments.ideal_px[:, 0]) / np.maximum(lengths, 1e-9)[:, None]
    pivot = segments.ideal_px.mean(axis=1) + segments.pivot_px[:, None] * along
    half = 0.5 * lengths[:, None] * along
    points = np.stack([pivot - half, pivot + half], axis=1)
    model = edge_model_px / math.sqrt(2.0)
    return LineMeasurements(
        rays=np.concatenate([points, np.full((len(points), 2, 1), focal_px)], axis=2),
        sigma_middle_px=np.hypot(model, segments.sigma_middle_px),
        sigma_slope_px=np.hypot(model, 0.5 * lengths * segments.sigma_angle_rad),
        ends_px=segments.ideal_px,
        lengths_px=lengths,
        along=along,
        polarity=segments.polarity,
    )
