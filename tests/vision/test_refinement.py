"""Refinement: the exact pose from rough ones, rivals kept, doublets dropped, deviations as documented."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE, exact_lines, poses_inside, segments_at
from scipy.stats import chi2
from toy_building import hall

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.association import Matches
from vision.camera import Camera
from vision.lines import ImageSegments
from vision.measurements import measured_lines
from vision.pose import LineObservations
from vision.projection import Projector
from vision.refinement import Candidate, RefinementConfig, Scene, Trial, View, refine_poses
from vision.weighing import observations

CONFIG = RefinementConfig()
POSE = Pose2(2.0, 5.5, -0.9)
#: A Gaussian error is beyond this once in ten thousand times.
HONEST = float(chi2.ppf(0.9999, 3))
#: Panels at equal distances: two of them look alike.
STEP_M = 0.7


def exact_scene(camera: Camera, wire_map: WireMap, pose: Pose2) -> Scene:
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    return scene_of(projector, exact_lines(camera, projector.predict(pose, rows)))


def scene_of(projector: Projector, lines: ImageSegments) -> Scene:
    rows = np.arange(len(projector.wire_map))
    return Scene(projector, rows, measured_lines(lines, projector.camera.focal_px, CONFIG.edge_model_px))


def rich_poses(camera: Camera, wire_map: WireMap, count: int, seed: int) -> list[Pose2]:
    projector, rows = Projector(camera, wire_map), np.arange(len(wire_map))
    poses = poses_inside(wire_map, np.random.default_rng(seed), 4 * count)
    return [pose for pose in poses if len(projector.predict(pose, rows)) >= 14][:count]


def moved(pose: Pose2, x: float, y: float, phi: float) -> Pose2:
    return Pose2(pose.x + x, pose.y + y, pose.phi + phi)


def away(candidate: Candidate, pose: Pose2) -> Array:
    return candidate.belief.pose.minus(pose)


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
def test_exact_lines_give_the_exact_pose_from_a_start_nearby(camera: Camera, toy_map: WireMap) -> None:
    rng = np.random.default_rng(51)
    poses = rich_poses(camera, toy_map, 8, 50)
    assert len(poses) == 8
    for pose in poses:
        start = moved(pose, *rng.uniform(-1.0, 1.0, 3) * [0.03, 0.03, math.radians(0.5)])
        found = refine_poses(exact_scene(camera, toy_map, pose), [start], 42, CONFIG)
        assert len(found) == 1
        assert np.abs(away(found[0], pose)).max() < 1e-3
        assert found[0].belief.stamp_ns == 42
        assert found[0].matched_segments >= 8
        assert found[0].score > 30.0


def test_a_camera_that_leans_is_seen_through(toy_map: WireMap) -> None:
    """Tilt, height and focal length are off by two deviations: 9 px in the image, which is no pose's fault."""
    mount = replace(CAMERA.mount, std_pitch_down_rad=0.008, std_roll_rad=0.004)
    believed = replace(CAMERA, std_focal=0.004, std_centre_px=1.0, mount=mount)
    truth = replace(
        believed,
        fx=believed.fx * 1.006,
        fy=believed.fy * 1.006,
        mount=replace(
            mount,
            height_m=mount.height_m - 0.01,
            pitch_down_rad=mount.pitch_down_rad + 0.016,
            roll_rad=mount.roll_rad - 0.008,
        ),
    )
    for pose in rich_poses(CAMERA, toy_map, 6, 52):
        lines = exact_lines(truth, Projector(truth, toy_map).predict(pose, np.arange(len(toy_map))))
        scene = scene_of(Projector(believed, toy_map), lines)
        found = refine_poses(scene, [moved(pose, 0.02, -0.02, 0.005)], 0, CONFIG)
        assert len(found) == 1
        error = away(found[0], pose)
        assert error @ np.linalg.solve(found[0].belief.covariance, error) < HONEST
        assert found[0].matched_segments >= 0.8 * len(np.unique(found[0].predicted.rows))


@pytest.mark.parametrize(
    ("std_rad", "believed_rad", "most_of_them"),
    [
        pytest.param(0.01, None, True, id="in doubt"),
        pytest.param(0.0, None, False, id="for certain"),
        pytest.param(0.0, 0.02, True, id="estimated"),
    ],
)
def test_a_first_gate_is_wide_enough_for_a_doubtful_camera(
    toy_map: WireMap, std_rad: float, believed_rad: float | None, most_of_them: bool
) -> None:
    """The camera looks down by 0.02 rad, 11 px, more than its file says."""
    mount = replace(CAMERA.mount, std_pitch_down_rad=std_rad, std_roll_rad=0.0)
    truth = replace(CAMERA, mount=replace(mount, pitch_down_rad=mount.pitch_down_rad + 0.02))
    lines = exact_lines(truth, Projector(truth, toy_map).predict(POSE, np.arange(len(toy_map))))
    scene = scene_of(Projector(replace(CAMERA, mount=mount), toy_map), lines)
    deviations = None if believed_rad is None else np.array([0.0, believed_rad, 0.0, 0.0, 0.0, 0.0, 0.0])
    matches = scene.view(Trial(POSE, deviations), 1.0).matches
    assert (len(matches) > 0.8 * len(lines)) == most_of_them


def test_starts_that_meet_are_one_candidate(toy_map: WireMap) -> None:
    starts = [moved(POSE, *shift) for shift in ((0, 0, 0), (0.02, 0, 0), (0, -0.02, 0), (0.01, 0.01, 0.006))]
    found = refine_poses(exact_scene(CAMERA, toy_map, POSE), starts, 0, CONFIG)
    assert len(found) == 1
    assert np.abs(away(found[0], POSE)).max() < 1e-3


def test_a_start_that_sees_nothing_drops_out(toy_map: WireMap) -> None:
    blank = Pose2(7.2, 3.2, 0.0)
    scene = exact_scene(CAMERA, toy_map, POSE)
    assert refine_poses(scene, [blank], 0, CONFIG) == []
    assert refine_poses(scene, [], 0, CONFIG) == []
    found = refine_poses(scene, [blank, POSE], 0, CONFIG)
    assert len(found) == 1
    assert np.abs(away(found[0], POSE)).max() < 1e-3


def test_an_image_without_lines_has_no_candidates(toy_map: WireMap) -> None:
    nothing = scene_of(Projector(CAMERA, toy_map), segments_at(np.zeros((0, 2, 2))))
    assert refine_poses(nothing, [POSE], 0, CONFIG) == []


def panels_alike(folder: Path) -> tuple[Scene, Pose2]:
    """Return a scene from before equal panels, without the room's corners."""
    wire_map = hall([0.5 + STEP_M * count for count in range(19)]).read(folder)
    pose = Pose2(7.0, 3.4, math.pi / 2)
    return exact_scene(CAMERA, wire_map, pose), pose


def test_a_rival_far_away_is_kept(tmp_path: Path) -> None:
    scene, pose = panels_alike(tmp_path)
    starts = [moved(pose, side * STEP_M + 0.02, -0.02, 0.004) for side in (-1, 0, 1)]
    found = refine_poses(scene, starts, 0, CONFIG)
    places = sorted(round(float(away(candidate, pose)[0]), 3) for candidate in found)
    assert places == pytest.approx([-STEP_M, 0.0, STEP_M], abs=2e-3)
    scores = [candidate.score for candidate in found]
    assert scores[0] - scores[-1] < 0.2 * scores[0]


def test_candidates_come_best_first_whatever_the_order_of_the_starts(tmp_path: Path) -> None:
    wire_map = hall([0.5, 1.2, 1.9, 2.6, 3.3, 4.0, 5.1, 5.8]).read(tmp_path)
    pose = Pose2(3.6, 3.4, math.pi / 2)
    scene = exact_scene(CAMERA, wire_map, pose)
    starts = [moved(pose, side * STEP_M, 0.0, 0.0) for side in (-1, 0, 1)]
    best = []
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        found = refine_poses(scene, [starts[number] for number in order], 0, CONFIG)
        scores = [candidate.score for candidate in found]
        assert scores == sorted(scores, reverse=True)
        best.append(away(found[0], pose))
    np.testing.assert_allclose(best, 0.0, atol=1e-3)


def doubled(offset_m: float, folder: Path) -> WireMap:
    """Return a hall whose panels each have a second outline aside: inner and outer edges of door linings."""
    panels = [1.0, 2.1, 4.0, 6.5]
    return hall(sorted([*panels, *(x + offset_m for x in panels)])).read(folder)


def test_neighbouring_optima_are_both_kept(tmp_path: Path) -> None:
    """With only one of two outlines in the image, the pose is either of two a few centimetres apart."""
    offset_m = 0.08
    wire_map = doubled(offset_m, tmp_path)
    pose = Pose2(3.6, 3.4, math.pi / 2)
    projector, rows = Projector(CAMERA, wire_map), np.arange(len(wire_map))
    view = projector.predict(pose, rows)
    outer = np.array(
        [
            not wire_map.names[row].startswith("panel") or int(wire_map.names[row][5]) % 2 == 0
            for row in view.rows
        ]
    )
    ceiling = np.array([wire_map.names[row].startswith("hall") for row in view.rows])
    lines = exact_lines(CAMERA, view)[outer & ~ceiling]
    starts = [pose, moved(pose, offset_m, 0.0, 0.0)]
    found = refine_poses(scene_of(projector, lines), starts, 0, CONFIG)
    assert sorted(float(away(candidate, pose)[0]) for candidate in found) == pytest.approx(
        [0.0, offset_m], abs=3e-3
    )


def test_trials_that_pair_far_less_than_the_best_go_no_further(tmp_path: Path) -> None:
    scene, pose = panels_alike(tmp_path)
    starts = [pose, moved(pose, 9 * STEP_M, 0.0, 0.0)]
    everything = replace(CONFIG, paired_share=(0.0, 0.0, 0.0))
    assert len(refine_poses(scene, starts, 0, everything)) == 2
    strict = replace(CONFIG, paired_share=(0.99, 0.99, 0.99))
    found = refine_poses(scene, starts, 0, strict)
    assert len(found) == 1
    assert np.abs(away(found[0], pose)).max() < 1e-3


def weighed(scene: Scene, view: View, spread: float = 1.0) -> LineObservations:
    """The pairs of a view as the estimator weighs them."""
    return observations(scene.projector, scene.lines, view.predicted, view.matches, view.map_px, spread)


def test_deviations_grow_with_the_spread_and_with_fragments(toy_map: WireMap) -> None:
    scene = exact_scene(CAMERA, toy_map, POSE)
    view = scene.view(Trial(POSE), 2.0)
    predicted, matches = view.predicted, view.matches
    assert len(matches) == len(predicted)
    seen = weighed(scene, view)
    rows = predicted.rows[matches.pieces]
    np.testing.assert_allclose(seen.rays, scene.lines.rays[matches.lines])
    np.testing.assert_allclose(
        seen.moments, np.cross(toy_map.endpoints[rows, 0], seen.directions), atol=1e-12
    )
    depth = predicted.depths_m[matches.pieces].mean(axis=1)
    map_px = CAMERA.focal_px * toy_map.sigma_m[rows] / depth
    np.testing.assert_allclose(
        seen.sigma_middle_px, np.hypot(map_px, scene.lines.sigma_middle_px[matches.lines])
    )
    wide = weighed(scene, view, spread=1.4)
    np.testing.assert_allclose(wide.sigma_middle_px, 1.4 * seen.sigma_middle_px)
    np.testing.assert_allclose(wide.sigma_slope_px, 1.4 * seen.sigma_slope_px)

    # Two lines on one piece share the error of its place: each is worth half.
    pick = np.zeros(2, np.int64)
    twice = Matches(
        matches.pieces[pick], matches.lines[pick], matches.spans_px[pick], matches.distances_px[pick]
    )
    line_px = scene.lines.sigma_middle_px[matches.lines[pick]]
    np.testing.assert_allclose(
        weighed(scene, replace(view, matches=twice)).sigma_middle_px ** 2 - line_px**2,
        2.0 * map_px[pick] ** 2,
    )


def test_a_short_line_says_little_of_its_edges_slope(toy_map: WireMap) -> None:
    """The map's error turns a short fragment less than the whole edge."""
    scene = exact_scene(CAMERA, toy_map, POSE)
    view = scene.projector.predict(POSE, scene.rows)
    whole = exact_lines(CAMERA, view)
    middle = whole.ideal_px.mean(axis=1, keepdims=True)
    half = scene_of(scene.projector, segments_at(middle + 0.5 * (whole.ideal_px - middle)))
    parts = []
    for one in (scene, half):
        view = one.view(Trial(POSE), 2.0)
        matches = view.matches
        order = np.argsort(matches.pieces)
        assert len(matches) == len(whole)
        own = one.lines.sigma_slope_px[matches.lines]
        parts.append((weighed(one, view).sigma_slope_px ** 2 - own**2)[order])
    np.testing.assert_allclose(parts[1], 0.25 * parts[0], rtol=1e-6)


def test_the_pose_is_as_sure_as_its_lines(toy_map: WireMap) -> None:
    found = [
        refine_poses(exact_scene(CAMERA, known, POSE), [POSE], 0, CONFIG)[0].belief.covariance
        for known in (toy_map, replace(toy_map, sigma_m=4.0 * toy_map.sigma_m))
    ]
    assert (np.diag(found[1]) > np.diag(found[0])).all()
    for covariance in found:
        assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_lines_bright_on_the_wrong_side_are_left_alone(toy_map: WireMap) -> None:
    known = replace(toy_map, polarity=np.ones(len(toy_map)))
    lines = exact_lines(CAMERA, Projector(CAMERA, known).predict(POSE, np.arange(len(known))))
    other = replace(lines, polarity=-lines.polarity)
    projector = Projector(CAMERA, known)
    assert len(refine_poses(scene_of(projector, lines), [POSE], 0, CONFIG)) == 1
    assert refine_poses(scene_of(projector, other), [POSE], 0, CONFIG) == []
