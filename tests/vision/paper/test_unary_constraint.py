"""The unary constraint: true pairs of exact data always pass, noisy ones as often as promised."""

from __future__ import annotations

import math

import numpy as np
import pytest
from paperviews import CAMERA, MOUNT, POINT, SIGMA_M, WINDOW, Views, exact_camera, views

from maps.poses import Array, wrap_angle
from vision.camera import Camera
from vision.constraints import segment_lines
from vision.paper.errors import LineErrors, bearings_of, line_errors
from vision.paper.unary import (
    Geometry,
    HeadingZones,
    heading_fits,
    heading_zones,
    position_fits,
    sector_fits,
    unary_constraint,
)

COUNT = 10_000
#: 2 sigma.
NOMINAL = math.erf(2.0 / math.sqrt(2.0))
SLOPES = pytest.mark.parametrize("slope", ["level", "sloped"])


def zones_of(
    seen: Views, camera: Camera, sigmas: float
) -> tuple[HeadingZones, LineErrors, Array, Array, Array]:
    errors = line_errors(camera, seen.segments)
    direction, points = segment_lines(seen.wire_map, seen.rows)
    offset = points - [*seen.disc.centre, MOUNT.height_m]
    ends = seen.wire_map.endpoints
    sigma = seen.wire_map.sigma_m
    skew = math.sqrt(2.0) * sigma / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    zones = heading_zones(errors.normals, errors.covariances, direction, skew, seen.disc, sigmas)
    return zones, errors, offset, math.sqrt(0.5) * sigma, direction


@SLOPES
def test_no_true_pair_of_exact_data_is_rejected(slope: str) -> None:
    seen = views(np.random.default_rng(1), COUNT, slope)
    zones, errors, offset, blur, _ = zones_of(seen, exact_camera(), 2.0)
    fits = heading_fits(zones, seen.disc)
    fits &= position_fits(errors.normals, errors.covariances, offset, blur, zones, seen.disc, 2.0)
    assert fits.any(axis=1).all()


@SLOPES
def test_a_root_is_the_true_heading(slope: str) -> None:
    seen = views(np.random.default_rng(2), COUNT, slope)
    zones, *_ = zones_of(seen, exact_camera(), 2.0)
    off = np.abs(wrap_angle(zones.roots - seen.cameras[:, :1])).min(axis=1)
    regular = zones.geometry == Geometry.REGULAR
    assert regular.mean() > 0.95
    assert np.quantile(off[regular], 0.99) < 1e-6


@SLOPES
def test_the_heading_is_as_sure_as_promised(slope: str) -> None:
    seen = views(np.random.default_rng(3), COUNT, slope, noise=1.0, window=POINT)
    zones, *_ = zones_of(seen, CAMERA, 2.0)
    assert heading_fits(zones, seen.disc).any(axis=1).mean() == pytest.approx(NOMINAL, abs=0.01)


@SLOPES
@pytest.mark.parametrize("principal", [True, False])
def test_the_position_line_is_as_sure_as_promised(slope: str, principal: bool) -> None:
    seen = views(np.random.default_rng(4), COUNT, slope, noise=1.0, window=POINT, principal=principal)
    zones, errors, offset, blur, _ = zones_of(seen, CAMERA, 2.0)
    true = np.broadcast_to(seen.cameras[:, :1], (COUNT, 2))
    zones = HeadingZones(true, true, true, zones.geometry)
    fits = position_fits(errors.normals, errors.covariances, offset, blur, zones, seen.disc, 2.0)
    assert fits[:, 0].mean() == pytest.approx(NOMINAL, abs=0.01)


@SLOPES
def test_noisy_true_pairs_pass_in_a_window(slope: str) -> None:
    seen = views(np.random.default_rng(5), COUNT, slope, noise=1.0)
    zones, errors, offset, blur, _ = zones_of(seen, CAMERA, 2.0)
    fits = heading_fits(zones, seen.disc)
    fits &= position_fits(errors.normals, errors.covariances, offset, blur, zones, seen.disc, 2.0)
    assert fits.any(axis=1).mean() >= 0.98


def test_zones_are_all_headings_within_the_errors() -> None:
    seen = views(np.random.default_rng(6), 300, "sloped", noise=1.0)
    errors = line_errors(CAMERA, seen.segments)
    # Wrong pairs, too: any line with any edge.
    shuffled = np.random.default_rng(7).permutation(300)
    direction, _ = segment_lines(seen.wire_map, shuffled)
    zones = heading_zones(
        errors.normals, np.zeros((300, 3, 3)), direction, np.full(300, 0.01), seen.disc, 2.0
    )
    psi = np.linspace(-np.pi, np.pi, 1441)
    for pair in range(300):
        v = direction[pair]
        turned = np.stack(
            [np.cos(psi) * v[0] + np.sin(psi) * v[1], np.cos(psi) * v[1] - np.sin(psi) * v[0], v[2] + 0 * psi]
        )
        allowed = np.abs(errors.normals[pair] @ turned) <= 2.0 * 0.01
        inside = np.zeros(len(psi), bool)
        for low, high in zip(zones.low[pair], zones.high[pair], strict=True):
            inside |= np.isfinite(low) & ((psi - np.nan_to_num(low)) % (2 * np.pi) <= high - low)
        assert (inside == allowed).mean() > 0.998


def test_position_test_against_all_headings_of_the_zone() -> None:
    rng = np.random.default_rng(8)
    seen = views(rng, 400, "sloped", noise=1.0)
    zones, errors, offset, _, _ = zones_of(seen, CAMERA, 2.0)
    offset = offset[rng.permutation(400)]
    sigma = 0.02
    none = np.zeros((400, 3, 3))
    fits = position_fits(errors.normals, none, offset, np.full(400, sigma), zones, seen.disc, 2.0)
    fits &= heading_fits(zones, seen.disc)
    for pair, root in np.ndindex(400, 2):
        n, p = errors.normals[pair], offset[pair]
        steps = np.linspace(zones.low[pair, root], zones.high[pair, root], 2001)
        steps = steps[np.abs(wrap_angle(steps - seen.disc.psi)) <= seen.disc.dpsi]
        value = np.cos(steps) * (n[0] * p[0] + n[1] * p[1]) + np.sin(steps) * (n[0] * p[1] - n[1] * p[0])
        room = np.hypot(n[0], n[1]) * seen.disc.radius_m + 2.0 * sigma
        least = np.abs(value + n[2] * p[2]).min(initial=np.inf)
        if abs(least - room) > 0.01:
            assert fits[pair, root] == (least <= room)


def test_geometry_is_named() -> None:
    disc = views(np.random.default_rng(9), 1, "level").disc
    normals = np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.1, 0.0, 0.995], [0.0, 1.0, 0.0]]
    )
    direction = np.array([[1.0, 0, 0], [0, 1, 0], [0.6, 0.0, 0.8], [0.0, 0.1, 0.995], [0.0, 0.0, 1.0]])
    # n . v = 0 on the rim for the third: |c| just above the length of (a, b) by less than its error.
    direction[2] = [0.79, 0.0, 0.613]
    zones = heading_zones(normals, np.zeros((5, 3, 3)), direction, np.full(5, 0.02), disc, 2.0)
    expected = [
        Geometry.REGULAR,
        Geometry.HORIZON_LINE,
        Geometry.TANGENT,
        Geometry.NO_REAL_ROOT,
        Geometry.VERTICAL_EDGE,
    ]
    assert zones.geometry.tolist() == expected


def test_both_roots_are_kept_where_both_fit() -> None:
    seen = views(np.random.default_rng(10), 12, "level")
    errors = line_errors(exact_camera(), seen.segments)
    everywhere = type(seen.disc)(seen.disc.centre, 1e6, seen.disc.psi, math.pi)
    found = unary_constraint(exact_camera(), seen.wire_map, errors, seen.rows, everywhere, 2.0)
    assert len(found) == found.tested == 144
    assert np.isfinite(found.psi).all()
    # The two roots of a level edge are half a turn apart.
    np.testing.assert_allclose(np.abs(wrap_angle(found.psi[:, 0] - found.psi[:, 1])), np.pi, atol=1e-6)


def test_most_wrong_pairs_are_rejected() -> None:
    seen = views(np.random.default_rng(11), 60, "level", noise=1.0)
    found = unary_constraint(
        CAMERA, seen.wire_map, line_errors(CAMERA, seen.segments), seen.rows, seen.disc, 2.0
    )
    true = (found.rows == found.lines).sum()
    assert true >= 58
    assert len(found) - true < 0.15 * (found.tested - 60)


def test_without_lines_or_segments_there_are_no_pairs() -> None:
    seen = views(np.random.default_rng(12), 4, "level")
    errors = line_errors(CAMERA, seen.segments)
    none = line_errors(CAMERA, seen.segments[np.zeros(0, np.int64)])
    assert len(unary_constraint(CAMERA, seen.wire_map, none, seen.rows, seen.disc, 2.0)) == 0
    assert len(unary_constraint(CAMERA, seen.wire_map, errors, seen.rows[:0], seen.disc, 2.0)) == 0


def test_the_sector_of_a_vertical_edge_holds_it() -> None:
    for noise, least in ((0.0, 1.0), (1.0, 0.98)):
        seen = views(np.random.default_rng(13), 400, "upright", noise=noise)
        points = seen.wire_map.endpoints.mean(axis=1)[:, :2]
        blur = np.full(400, SIGMA_M)
        fits = sector_fits(bearings_of(CAMERA, seen.segments), seen.rows, points, blur, seen.disc, 2.0)
        assert np.diag(fits).mean() >= least
        assert fits.mean() < 0.9
    assert WINDOW.dt_m > 0.0
