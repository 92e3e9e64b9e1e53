"""Where the next image should be searched."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from localization.ekf import quantile
from localization.trust import Mind
from maps.outcomes import PoseBelief, PoseEllipsoid, SearchWindow
from maps.poses import Array


class WindowShape(StrEnum):
    """What of a belief bounds a window."""

    #: The paper's: a radius and a range of headings, about the belief's ellipse.
    DISC = "disc"
    #: Besides, the belief's own ellipsoid, x, y and phi together.
    ELLIPSE = "ellipse"


@dataclass(frozen=True, slots=True)
class WindowConfig:
    """How a belief becomes a search window (paper, section 3.2).

    `probability`: that the true pose lies within the position radius, within the heading's, and within the
    ellipsoid of a window of that `shape`.
    `floor_m`, `floor_rad`: least half-widths; below them a search is not faster, and what the filter
    believes is not that exact. `growth`: by this factor after each frame without a fix, since then
    the belief itself is in doubt, up to `largest_growth`.
    `doubt`: where the robot is at none of the places known with more probability than this, search everywhere too;
    two images that do not show what they should make it so.
    `unexplained`: so many looks on end that were not fused, with something to see, do too: where nothing is expected,
    nothing can be missing. A place that fixes strain, or that is wrong with more probability than `doubt` because
    others compete with it, is searched for within `aside_m` and `aside_rad`: slipped wheels lead no farther.
    `least`: places of less probability are not searched for, nor more than `most`.
    """

    probability: float = 0.999
    floor_m: float = 0.15
    floor_rad: float = math.radians(3.0)
    growth: float = 1.4
    largest_growth: float = 5.0
    doubt: float = 0.1
    unexplained: float = 3.0
    aside_m: float = 1.0
    aside_rad: float = math.radians(20.0)
    least: float = 0.02
    most: int = 3
    shape: WindowShape = WindowShape.ELLIPSE


def position_radius(covariance: Array, probability: float) -> float:
    """Return the radius of the circle about the probability ellipse of a position covariance (2, 2)."""
    widest = float(np.linalg.eigvalsh(covariance)[-1])
    return math.sqrt(quantile(probability, 2) * max(widest, 0.0))


def heading_radius(variance: float, probability: float) -> float:
    """Return the half-width of a heading's interval of this probability."""
    return math.sqrt(quantile(probability, 1) * variance)


def search_windows(mind: Mind, config: WindowConfig) -> tuple[SearchWindow, ...]:
    """Return where a robot may be by what it knows: about each place that counts, and everywhere if in doubt.

    The widest comes last. About a place that is expected a look finds more than everywhere.
    """
    best, leading = mind.hypotheses.places, mind.leading
    if leading is None:
        return (SearchWindow.everywhere(),)
    others = [place for place in best if place is not leading and place.weight >= config.least]
    growths = [(leading, mind.misses if mind.trusted else 0), *((place, 0) for place in others)]
    windows = [
        window_about(place.estimate.belief, misses, config) for place, misses in growths[: config.most]
    ]
    # Far away there is always something that fits; what pulls is near, and what competes has its own window.
    far = mind.hypotheses.elsewhere > config.doubt and not mind.strained
    rivalled = mind.trusted and leading.weight < 1.0 - config.doubt and not far
    if mind.strained or rivalled:
        windows.append(SearchWindow(leading.estimate.pose, config.aside_m, config.aside_rad))
    if not mind.trusted or far or mind.unexplained >= config.unexplained:
        windows.append(SearchWindow.everywhere())
    return tuple(sorted(dict.fromkeys(windows), key=lambda window: (window.dt_m, window.dphi_rad)))


def slip_windows(mind: Mind, config: WindowConfig) -> tuple[SearchWindow, ...]:
    """Return where to search an image too that shows nothing in the windows above: where a slip may have led.

    Wheels seldom slip, and in a window this much wider a place needs more evidence.
    """
    leading = mind.leading
    if leading is None or not leading.estimate.slip.any():
        return ()
    return (window_about(leading.estimate.wide, mind.misses if mind.trusted else 0, config),)


def window_about(belief: PoseBelief, misses: int, config: WindowConfig) -> SearchWindow:
    """Return the window about a belief after so many looks without a fix."""
    growth = min(config.growth**misses, config.largest_growth)
    dt_m = position_radius(belief.covariance[:2, :2], config.probability)
    dphi_rad = heading_radius(belief.covariance[2, 2], config.probability)
    return SearchWindow(
        belief.pose,
        growth * max(dt_m, config.floor_m),
        min(growth * max(dphi_rad, config.floor_rad), math.pi),
        _ellipsoid(belief, growth, config) if config.shape is WindowShape.ELLIPSE else None,
    )


def _ellipsoid(belief: PoseBelief, growth: float, config: WindowConfig) -> PoseEllipsoid:
    """The belief's ellipsoid, thick enough to hold the least disc and slice of headings."""
    gate = quantile(config.probability, 3)
    least = np.array([config.floor_m, config.floor_m, config.floor_rad]) / math.sqrt(gate)
    # In units of the least half-widths that cylinder reaches out to the root of two.
    squares, axes = np.linalg.eigh(belief.covariance / np.outer(least, least))
    thick = (axes * np.maximum(squares, 2.0)) @ axes.T * np.outer(least, least)
    return PoseEllipsoid(belief.pose, growth**2 * thick, gate)
