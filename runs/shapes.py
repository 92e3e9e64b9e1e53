"""Outlines in plan view, shared by the recording and the plots: (K, 2) metres, map frame, closed."""

from __future__ import annotations

import math

import numpy as np
from shapely.geometry import MultiPolygon

from maps.outcomes import PoseEllipsoid, SearchWindow
from maps.poses import Array

#: Half-axes longer than this are cut: a corridor's fix has one as long as the corridor, and longer.
LONGEST_HALF_AXIS_M = 2.0

#: An ellipse this many standard deviations wide holds 95 % of a planar Gaussian.
SIGMAS_95 = 2.448

_TURN = np.linspace(0.0, 2.0 * np.pi, 25)
_CIRCLE = np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def ellipse(centre: Array, covariance: Array) -> Array:
    """Return the 95 % ellipse of a position, (25, 2); empty (0, 2) where it was not measured.

    `centre`: (2,), `covariance`: (2, 2) [m^2].
    """
    if not np.isfinite(covariance).all():
        return np.zeros((0, 2))
    variances, axes = np.linalg.eigh(covariance)
    half_axes = np.minimum(SIGMAS_95 * np.sqrt(np.maximum(variances, 0.0)), LONGEST_HALF_AXIS_M)
    outline: Array = centre + (_CIRCLE * half_axes) @ axes.T
    return outline


def disc(centre: Array, radius_m: float) -> Array:
    """Return a circle, (25, 2)."""
    return centre + radius_m * _CIRCLE


def heading_wedge(window: SearchWindow) -> Array:
    """Return the headings that a window allows, as a slice of its disc, (K, 2)."""
    centre = np.array([window.centre.x, window.centre.y])
    half = min(window.dphi_rad, math.pi)
    angles = window.centre.phi + np.linspace(-half, half, 13)
    arc = centre + window.dt_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.vstack([centre, arc, centre])


def window_ellipse(ellipsoid: PoseEllipsoid) -> Array:
    """Return the positions that a window's ellipsoid leaves, whatever the heading, (25, 2)."""
    variances, axes = np.linalg.eigh(ellipsoid.gate * ellipsoid.covariance[:2, :2])
    centre = np.array([ellipsoid.centre.x, ellipsoid.centre.y])
    outline: Array = centre + (_CIRCLE * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
    return outline


def floor_rings(floor: MultiPolygon) -> list[Array]:
    """Return the outlines of a floor and of its holes, each (K, 2)."""
    return [
        np.asarray(ring.coords)[:, :2]
        for polygon in floor.geoms
        for ring in (polygon.exterior, *polygon.interiors)
    ]
