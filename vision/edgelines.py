"""Straight edges in an image: gradient, edge pixels, chains, pieces, lines, joined lines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.poses import Array
from vision import linefit
from vision.camera import Camera
from vision.edgepoints import Cells, link_edges, mark_edges, measure_points, pixels_of
from vision.gradient import Gradient, gradient_of, pixel_noise
from vision.images import GreyImage
from vision.joining import join_lines
from vision.linefit import fit_lines
from vision.pieces import members_of, split_chains
from vision.straightening import straighten

#: Measurements of one line that a prior on their noise is worth.
_PRIOR_LOOKS = 10.0
#: Standard deviation of a pixel, grey levels, that rounding alone gives it.
_ROUNDING = 1.0 / math.sqrt(12.0)


@dataclass(frozen=True, slots=True)
class EdgeConfig:
    """What counts as an edge, and what as straight."""

    #: Standard deviation of the Gaussian that the gradient is taken with: in a clean image, and at most. More
    #: of it shows weaker edges and runs close ones together.
    smoothing_px: float = 1.0
    smoothing_most_px: float = 1.5
    #: Noise of a pixel, grey levels, above which the image is smoothed more.
    clean_noise: float = 3.0
    #: An edge pixel's gradient, in deviations of the gradient's noise, and at least, grey levels per pixel.
    low_noise: float = 3.0
    low_least: float = 1.0
    #: How much stronger the pixel must be that a chain starts from.
    high_ratio: float = 1.5
    #: Edge pixels, to half a pixel, may lie this far from the chord of their piece.
    straight_px: float = 1.2
    #: Pieces shorter than this are not fitted.
    piece_px: float = 12.0
    #: Longest gap in an edge that is bridged.
    gap_px: float = 60.0
    #: Fitted points scatter by no more than this about a straight edge.
    scatter_px: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class EdgeLines:
    """M straight edges, the brighter side on the right from first to second end.

    `ideal_px`: (M, 2, 2) ends; `raw_px`: (M, 2, 2) the edge points next to them. `sigma_middle_px`,
    `sigma_angle_rad`: (M,) standard deviations of the middle across the line and of the direction.
    `contrast`: (M,) grey levels.
    """

    ideal_px: Array
    raw_px: Array
    sigma_middle_px: Array
    sigma_angle_rad: Array
    contrast: Array


@dataclass(frozen=True, slots=True, eq=False)
class Contours:
    """Chains of edge pixels, the brighter side on the right: `cells` (Q,) and `starts` (C + 1,) of the chains."""

    gradient: Gradient
    smoothing_px: float
    cells: Cells
    starts: Cells


def find_contours(image: GreyImage, config: EdgeConfig, least: int) -> Contours:
    """Find the contours of a grey image (H, W) by Canny's method, in chains of at least `least` pixels."""
    # The noise of the gradient falls with the square of the smoothing.
    smoothing_px = config.smoothing_px * math.sqrt(max(pixel_noise(image) / config.clean_noise, 1.0))
    smoothing_px = min(smoothing_px, config.smoothing_most_px)
    gradient = gradient_of(image, smoothing_px)
    low = max(config.low_noise * gradient.noise, config.low_least)
    marks, seeds = mark_edges(gradient.dx, gradient.dy, low, config.high_ratio * low)
    cells, starts = link_edges(gradient.dx, gradient.dy, marks, seeds, least)
    return Contours(gradient, smoothing_px, cells, starts)


def find_edges(image: GreyImage, camera: Camera, config: EdgeConfig, min_length_px: float = 0.0) -> EdgeLines:
    """Find the straight edges of a grey image (H, W), straight after undistortion, of some length."""
    least = max(int(0.7 * config.piece_px), 2)
    contours = find_contours(image, config, least)
    gradient, cells = contours.gradient, contours.cells
    pixels = straighten(pixels_of(cells, image.shape[1]), camera)
    pieces = split_chains(pixels, contours.starts, config.straight_px, config.piece_px)
    members, bounds = members_of(pieces)
    points = measure_points(gradient.dx, gradient.dy, cells[members])
    lines = fit_lines(points, straighten(points, camera), bounds)
    lines = lines[lines[:, linefit.W] >= 0.5 * least]
    lines = join_lines(lines, gradient.dx, gradient.dy, config.gap_px)
    along = lines[:, linefit.END : linefit.END + 2] - lines[:, linefit.START : linefit.START + 2]
    lines = lines[np.hypot(along[:, 0], along[:, 1]) >= min_length_px]
    return _measured(lines, gradient.noise, contours.smoothing_px, config.scatter_px)


def _measured(lines: Array, noise: float, smoothing_px: float, scatter_px: float) -> EdgeLines:
    """Contrast, and standard deviations from the image's noise and the points' scatter; not the crooked ones.

    Smoothing correlates what neighbouring points tell: points h apart along the edge are worth
    h / (sqrt(4 pi) s) each.
    """
    noise = max(noise, _ROUNDING / (math.sqrt(8.0 * math.pi) * smoothing_px**2))
    along = lines[:, linefit.ALONG : linefit.ALONG + 2]
    spread, scatter = _second_moments(lines, along)
    straight = scatter <= scatter_px**2
    lines, along, spread, scatter = lines[straight], along[straight], spread[straight], scatter[straight]
    count = lines[:, linefit.W]
    strength, sharpness = (lines[:, column] / count for column in (linefit.WSTRENGTH, linefit.WSHARPNESS))
    steep = np.abs(along).max(axis=1)
    shared = math.sqrt(4.0 * math.pi) * smoothing_px * steep
    looks = np.maximum(count / shared - 2.0, 0.0)
    expected = _expected_scatter(noise / (strength * sharpness), steep, smoothing_px)
    # The two parameters of a line take their share of the scatter.
    pooled = (looks + 2.0) * scatter + _PRIOR_LOOKS * expected
    variance = pooled / (looks + _PRIOR_LOOKS) * shared / count
    ends = lines[:, linefit.START : linefit.START + 4].reshape(-1, 2, 2)
    middle = lines[:, [linefit.WX, linefit.WY]] / count[:, None]
    lever = ((ends.mean(axis=1) - middle) * along).sum(axis=1)
    return EdgeLines(
        ideal_px=ends,
        raw_px=lines[:, linefit.RAW_START : linefit.RAW_START + 4].reshape(-1, 2, 2),
        sigma_middle_px=np.sqrt(variance * (1.0 + lever**2 / spread)),
        sigma_angle_rad=np.sqrt(variance / spread),
        contrast=strength * np.sqrt(2.0 * math.pi / sharpness),
    )


def _second_moments(lines: Array, along: Array) -> tuple[Array, Array]:
    """Mean squared distances of a line's points from their middle: along the line and across it, (M,)."""
    count = lines[:, linefit.W]
    x, y = lines[:, linefit.WX] / count, lines[:, linefit.WY] / count
    xx = lines[:, linefit.WXX] / count - x * x
    xy = lines[:, linefit.WXY] / count - x * y
    yy = lines[:, linefit.WYY] / count - y * y
    spread = xx * along[:, 0] ** 2 + 2.0 * xy * along[:, 0] * along[:, 1] + yy * along[:, 1] ** 2
    return spread, np.maximum(xx + yy - spread, 0.0)


def _expected_scatter(softness: Array, steep: Array, smoothing_px: float) -> Array:
    """Variance of one point's place across the edge, (M,), that the noise of the gradient explains.

    `softness`: noise over strength and sharpness. A point is half the difference of two samples, a pixel to
    either side along the axis whose cosine with the edge's normal is `steep`, over the other two; noise
    smoothed by a Gaussian is correlated between them.
    """
    lag = 1.0 / smoothing_px**2
    alike = (1.0 - 2.0 * steep**2 * lag) * math.exp(-lag)
    return np.asarray(0.5 * (1.0 - alike) * (softness / steep) ** 2)
