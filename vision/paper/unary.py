"""The unary constraint on a model segment and an image line (section 3.2, equations 1 and 2).

(2.a) gives the heading: two roots, of which those that fit the window are kept. (2.b) then confines the camera
to a line of the plan, which must meet the window's disc. Both within the line's errors (section 3.4): a pair is
kept if some line within them meets the window. Section 3.2 has no unary test for vertical edges; a sector of
bearings that the paper missed is offered beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, wrap_angle
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import heading_roots, heading_terms, segment_lines
from vision.paper.errors import Bearings, LineErrors
from vision.paper.selection import ViewedDisc
from vision.paper.tables import ToleranceTable

#: Pairs handled at once, so that the arrays stay small.
_BLOCK = 20_000


class Geometry(IntEnum):
    """What equation (2.a) has to say about a pair."""

    REGULAR = 0
    #: c exceeds sqrt(a^2 + b^2), within the errors: one heading, where the two roots meet.
    TANGENT = 1
    #: The same beyond the errors: no heading at all.
    NO_REAL_ROOT = 2
    #: The image line is the horizon, within the errors: every heading will do.
    HORIZON_LINE = 3
    #: a = b = 0: the edge says nothing about the heading.
    VERTICAL_EDGE = 4


@dataclass(frozen=True, slots=True, eq=False)
class UnaryPairs:
    """P pairs that pass.

    `rows`: (P,) of the wire map, `lines`: (P,) of the image. `psi`: (P, 2) the camera's headings by (2.a), as
    measured; NaN for a root that does not fit the window. `geometry`: (P,) values of `Geometry`. `tested`: how
    many pairs there were.
    """

    rows: NDArray[np.int64]
    lines: NDArray[np.int64]
    psi: Array
    geometry: NDArray[np.int8]
    tested: int

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, slots=True, eq=False)
class HeadingZones:
    """Where (2.a) puts the heading psi of C pairs, for both roots: (C, 2) each, radians.

    `roots`: as measured. `low`, `high`: the ends of the zone that the errors leave, `low` <= `high`, less than a
    turn apart; NaN where there is no real root. `geometry`: (C,).
    """

    roots: Array
    low: Array
    high: Array
    geometry: NDArray[np.int8]


def unary_constraint(
    camera: Camera,
    wire_map: WireMap,
    errors: LineErrors,
    rows: NDArray[np.int64],
    disc: ViewedDisc,
    sigmas: float,
    table: ToleranceTable | None = None,
) -> UnaryPairs:
    """Return the pairs of the non-vertical segments `rows` and all image lines that fit the window.

    `table`: tolerances by Monte Carlo; without one the errors are propagated.
    """
    each = max(_BLOCK // max(len(errors), 1), 1)
    found = [
        _of_block(camera, wire_map, errors, rows[first : first + each], disc, sigmas, table)
        for first in range(0, max(len(rows), 1), each)
    ]
    row, line, psi, geometry = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return UnaryPairs(row, line, psi, geometry, len(rows) * len(errors))


def _of_block(
    camera: Camera,
    wire_map: WireMap,
    errors: LineErrors,
    rows: NDArray[np.int64],
    disc: ViewedDisc,
    sigmas: float,
    table: ToleranceTable | None,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, NDArray[np.int8]]:
    """Rows, lines, headings and geometry of the pairs of some segments that pass."""
    row, line = (grid.ravel() for grid in np.meshgrid(rows, np.arange(len(errors)), indexing="ij"))
    direction, points = segment_lines(wire_map, row)
    offset = points - [*disc.centre, camera.mount.height_m]
    map_sigma = wire_map.sigma_m[row]
    length = np.linalg.norm(wire_map.endpoints[row, 1] - wire_map.endpoints[row, 0], axis=1)
    normals, covariances = errors.normals[line], errors.covariances[line]
    skew = np.sqrt(2.0) * map_sigma / length
    zones = heading_zones(normals, covariances, direction, skew, disc, sigmas)
    if table is None:
        fits = heading_fits(zones, disc)
        blur = np.hypot(np.sqrt(0.5) * map_sigma, np.abs(normals[:, 2]) * camera.mount.std_height_m)
        fits &= position_fits(normals, covariances, offset, blur, zones, disc, sigmas)
    else:
        fits = table.fits(normals, direction, offset, zones.roots, disc, sigmas)
        fits &= np.isfinite(zones.low)
    keep = fits.any(axis=1)
    psi = np.where(fits, wrap_angle(zones.roots), np.nan)
    return row[keep], line[keep], psi[keep], zones.geometry[keep]


def heading_zones(
    normals: Array, covariances: Array, direction: Array, skew: Array, disc: ViewedDisc, sigmas: float
) -> HeadingZones:
    """Return the headings that (2.a) allows within the errors: |a cos psi + b sin psi + c| <= k sigma.

    `normals`, `direction`: (C, 3) unit vectors, level and map frame; `covariances`: (C, 3, 3) of the normals;
    `skew`: (C,) how well the segments' directions are known, radians. The zone of each root is exact in psi:
    no slope is divided by, so that roots that nearly meet, or hardly exist, are no special case.
    """
    a, b, c = heading_terms(normals, direction)
    middle, spread = heading_roots(a, b, c)
    r = np.maximum(np.hypot(a, b), 1e-12)
    roots = middle[:, None] + spread[:, None] * [1.0, -1.0]
    away = np.clip(wrap_angle(roots - disc.psi), -disc.dpsi, disc.dpsi)
    at = _turned(direction[:, None], disc.psi + away)
    sigma = np.hypot(np.sqrt(_variances(covariances, at)), skew[:, None])
    least, most = ((-c[:, None] + side * sigmas * sigma) / r[:, None] for side in (-1.0, 1.0))
    near, far = np.arccos(np.clip(most, -1.0, 1.0)), np.arccos(np.clip(least, -1.0, 1.0))
    low = middle[:, None] + np.column_stack([near[:, 0], -far[:, 1]])
    high = middle[:, None] + np.column_stack([far[:, 0], -near[:, 1]])
    none = (most < -1.0) | (least > 1.0)
    every = (least <= -1.0) & (most >= 1.0)
    geometry = np.where(np.abs(c) > r, Geometry.TANGENT, Geometry.REGULAR)
    geometry = np.where(every.all(axis=1), Geometry.HORIZON_LINE, geometry)
    geometry = np.where(none.all(axis=1), Geometry.NO_REAL_ROOT, geometry)
    geometry = np.where(np.hypot(direction[:, 0], direction[:, 1]) < 1e-9, Geometry.VERTICAL_EDGE, geometry)
    low, high = np.where(none, np.nan, low), np.where(none, np.nan, high)
    return HeadingZones(roots, low, high, geometry.astype(np.int8))


def heading_fits(zones: HeadingZones, disc: ViewedDisc) -> NDArray[np.bool_]:
    """Return whether some heading of each zone is in the window, (C, 2): |phi - phi_e| < dphi."""
    half = 0.5 * (zones.high - zones.low)
    result: NDArray[np.bool_] = np.abs(wrap_angle(zones.low + half - disc.psi)) <= disc.dpsi + half
    return result


def position_fits(
    normals: Array,
    covariances: Array,
    offset: Array,
    blur: Array,
    zones: HeadingZones,
    disc: ViewedDisc,
    sigmas: float,
) -> NDArray[np.bool_]:
    """Return whether some line (2.b) of each zone meets the disc within the errors, (C, 2).

    `offset`: (C, 3) from the disc's centre, at the camera's height, to the segments' middles. `blur`: (C,) metres
    that map and height add. Equation (1.b) is (1.a) with p - T for v, so it is a cosine of psi, too; it is not
    divided by sqrt(A^2 + B^2), which vanishes for the horizon.
    """
    half = 0.5 * (zones.high - zones.low)
    away = wrap_angle(zones.low + half - disc.psi)
    # The part of the zone inside the window; all of it where the two could meet on both sides.
    both_sides = disc.dpsi + half >= np.pi
    low = np.where(both_sides, away - half, np.maximum(away - half, -disc.dpsi))
    high = np.where(both_sides, away + half, np.minimum(away + half, disc.dpsi))
    nearest, at = _least_distance(normals, offset, disc.psi + low, disc.psi + high)
    variance = _variances(covariances, _turned(offset[:, None], at)) + blur[:, None] ** 2
    steepness = np.hypot(normals[:, 0], normals[:, 1])[:, None]
    with np.errstate(invalid="ignore"):
        result: NDArray[np.bool_] = nearest <= steepness * disc.radius_m + sigmas * np.sqrt(variance)
    return result


def sector_fits(
    bearings: Bearings,
    lines: NDArray[np.int64],
    points: Array,
    blur: Array,
    disc: ViewedDisc,
    sigmas: float,
) -> NDArray[np.bool_]:
    """Return whether vertical edges at `points` (K, 2) can be seen at the lines' bearings, (K, nv).

    The test that the paper missed: bearing in the map less bearing in the image is the heading.
    """
    offset = points - disc.centre
    distance = np.linalg.norm(offset, axis=1)
    reach = np.where(
        distance > disc.radius_m,
        np.arcsin(np.minimum(disc.radius_m / np.maximum(distance, 1e-9), 1.0)),
        np.pi,
    )
    sigma = np.hypot(bearings.own[lines], np.linalg.norm(bearings.shared[lines], axis=1))
    sigma = np.hypot(sigma[None], (blur / np.maximum(distance - disc.radius_m, 0.3))[:, None])
    seen = np.arctan2(offset[:, 1], offset[:, 0])
    away = wrap_angle(seen[:, None] - bearings.bearings[lines] - disc.psi)
    result: NDArray[np.bool_] = np.abs(away) <= disc.dpsi + reach[:, None] + sigmas * sigma
    return result


def _least_distance(normals: Array, offset: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The least |n . Rz(-psi) offset| for psi from low to high (C, 2), and where it is reached."""
    a, b, c = (term[:, None] for term in heading_terms(normals, offset))
    at_low, at_high = (a * np.cos(psi) + b * np.sin(psi) + c for psi in (low, high))
    best = np.where(np.abs(at_low) <= np.abs(at_high), at_low, at_high)
    where = np.where(np.abs(at_low) <= np.abs(at_high), low, high)
    middle, spread = heading_roots(a, b, c)
    for stop in (middle + spread, middle - spread):
        # The nearest turn of this stop at or after `low`.
        psi = low + (stop - low) % (2.0 * np.pi)
        value = a * np.cos(psi) + b * np.sin(psi) + c
        better = (psi <= high) & (np.abs(value) < np.abs(best))
        best, where = np.where(better, value, best), np.where(better, psi, where)
    return np.abs(best), where


def _turned(vectors: Array, psi: Array) -> Array:
    """Rz(-psi) vectors: (..., 3) in the level frame of a camera that heads psi (...)."""
    cos, sin = np.cos(psi), np.sin(psi)
    x, y, z = (np.broadcast_to(vectors[..., axis], psi.shape) for axis in range(3))
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)


def _variances(covariances: Array, vectors: Array) -> Array:
    """Variances of n . w for normals (C, 3) with these covariances and vectors (C, 2, 3): (C, 2)."""
    result: Array = np.einsum("cri,cij,crj->cr", vectors, covariances, vectors)
    return np.maximum(result, 0.0)
