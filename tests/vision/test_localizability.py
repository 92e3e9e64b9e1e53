"""Expected fixes: the bound is what simulated fixes reach, and corridors show."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawing import CAMERA
from toy_building import hall

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.localizability import ExpectationConfig, ExpectedLook, expected_look, expected_observations
from vision.pose import LineObservations, distances_and_jacobian, estimate_pose, nuisance_information
from vision.projection import Projector

CONFIG = ExpectationConfig()


def seen_always(wire_map: WireMap, rate: float = 0.98) -> WireMap:
    return replace(wire_map, detection_rate=np.full(len(wire_map), rate))


def look_from(wire_map: WireMap, pose: Pose2) -> ExpectedLook:
    return expected_look(Projector(CAMERA, wire_map), pose, np.arange(len(wire_map)), CONFIG)


def simulated(seen: LineObservations, pose: Pose2, rng: np.random.Generator) -> LineObservations:
    """Move the image lines by noise, and by the camera's deviations drawn from their priors."""
    state = np.zeros(10)
    state[:3] = pose.as_array()
    state[3:] = rng.normal(0.0, nuisance_information(CAMERA) ** -0.5)
    middle, slope = rng.normal(0.0, seen.sigma_middle_px), rng.normal(0.0, seen.sigma_slope_px)
    wanted = np.stack([middle - slope, middle + slope], axis=1)
    way = seen.rays[:, 1, :2] - seen.rays[:, 0, :2]
    across = np.column_stack([-way[:, 1], way[:, 0], np.zeros(len(way))])
    across /= np.linalg.norm(across, axis=1)[:, None]
    now, moved = (
        distances_and_jacobian(state, CAMERA, replace(seen, rays=seen.rays + step * across[:, None]))[0]
        for step in (0.0, 1.0)
    )
    # Distances are linear in a shift of the points.
    shift = (wanted - now) / (moved - now)
    return replace(seen, rays=seen.rays + shift[..., None] * across[:, None])


@pytest.mark.parametrize("pose", [Pose2(1.5, 1.0, 0.6), Pose2(4.0, 1.5, 0.1), Pose2(10.5, 1.5, 3.0)])
def test_simulated_fixes_scatter_as_the_bound_says(toy_map: WireMap, pose: Pose2) -> None:
    wire_map, rng = seen_always(toy_map, 0.99), np.random.default_rng(51)
    projector, look = Projector(CAMERA, wire_map), look_from(wire_map, pose)
    seen = expected_observations(projector, look.predicted, look.rates, CONFIG.lines)
    errors: list[Array] = []
    for _ in range(400):
        estimate = estimate_pose(pose, CAMERA, simulated(seen, pose, rng))
        errors.append(estimate.pose.minus(pose))
    scatter = np.cov(np.array(errors).T)
    # Variances along the bound's own axes: each is estimated to 7 %, and the estimator gives away a little.
    values, axes = np.linalg.eigh(look.covariance)
    ratio = np.diag(axes.T @ scatter @ axes) / values
    assert (ratio > 0.75).all()
    assert (ratio < 1.4).all()


def test_a_corridor_seen_along_its_axis_leaves_the_way_along_it_open(tmp_path: Path) -> None:
    corridor = hall([], length_m=60.0).read(tmp_path)
    look = look_from(corridor, Pose2(10.0, 3.0, 0.0))
    major, minor = look.sigma_m
    assert minor is not None
    assert major is None or major > 10.0 * minor
    _, axes = np.linalg.eigh(look.covariance[:2, :2])
    assert abs(axes[0, 1]) > 0.99


def test_what_is_seen_less_often_fixes_less(toy_map: WireMap) -> None:
    pose = Pose2(4.0, 1.5, 0.0)
    often, rarely = (look_from(seen_always(toy_map, rate), pose) for rate in (0.9, 0.2))
    assert np.linalg.eigvalsh(rarely.covariance - often.covariance).min() > 0.0


def test_a_map_known_less_well_fixes_less(toy_map: WireMap) -> None:
    pose, vague = Pose2(4.0, 1.5, 0.0), replace(toy_map, sigma_m=5.0 * toy_map.sigma_m)
    better, worse = look_from(toy_map, pose).sigma_m[0], look_from(vague, pose).sigma_m[0]
    assert better is not None
    assert worse is not None
    assert worse > 2.0 * better


def test_nothing_in_view_constrains_nothing(toy_map: WireMap) -> None:
    look = look_from(toy_map, Pose2(7.7, 3.0, 0.0))
    assert look.segments == 0
    assert look.sigma_m == (None, None)
    assert look.sigma_phi is None


def test_segments_are_counted_once_however_many_pieces_they_show(toy_map: WireMap) -> None:
    # The pillar stands before the far wall.
    look = look_from(toy_map, Pose2(3.2, 6.5, -0.5 * math.pi))
    assert look.segments == len(set(look.predicted.rows.tolist()))
    assert look.segments < len(look.predicted)
