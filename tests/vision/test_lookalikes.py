"""Places that look like another: found from one of them, whichever a search happened to find first."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from drawing import CAMERA, draw
from toy_building import hall

from maps.poses import Pose2
from vision.lines import LineConfig, extract_segments
from vision.lookalikes import lookalikes, with_lookalikes
from vision.measurements import measured_lines
from vision.projection import Projector
from vision.refinement import Candidate, RefinementConfig, Scene, refine_poses

CONFIG = RefinementConfig()
STEP_M = 0.7
POSE = Pose2(7.0, 3.4, math.pi / 2)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Equal panels along the far wall of a hall, seen from its middle."""
    building = hall([0.5 + STEP_M * count for count in range(19)])
    wire_map = building.read(tmp_path_factory.mktemp("hall"))
    segments = extract_segments(
        draw(building.faces, CAMERA, POSE, np.random.default_rng(30)), CAMERA, LineConfig()
    )
    lines = measured_lines(segments, CAMERA.focal_px, CONFIG.edge_model_px)
    return Scene(Projector(CAMERA, wire_map), np.arange(len(wire_map)), lines)


def found_at(scene: Scene, pose: Pose2) -> list[Candidate]:
    found = refine_poses(scene, [pose], 5, CONFIG)
    assert len(found) == 1
    return found


def test_from_a_wrong_place_the_right_one_is_found(scene: Scene) -> None:
    one = found_at(scene, Pose2(POSE.x + STEP_M, POSE.y, POSE.phi))
    assert abs(one[0].belief.pose.x - POSE.x - STEP_M) < 0.05
    every = with_lookalikes(scene, one, 5, CONFIG)
    assert one[0] in every
    away = [np.abs(candidate.belief.pose.minus(POSE)).max() for candidate in every]
    assert min(away) < 0.03
    assert [candidate.score for candidate in every] == sorted((c.score for c in every), reverse=True)
    assert {candidate.belief.stamp_ns for candidate in every} == {5}
    places = [candidate.belief.pose.as_array() for candidate in every]
    gaps = [np.abs(a - b).max() for k, a in enumerate(places) for b in places[:k]]
    assert min(gaps) > CONFIG.same_rad, "none twice"


def test_lookalikes_are_steps_along_the_wall_and_on_the_floor(scene: Scene) -> None:
    [one] = found_at(scene, POSE)
    there = lookalikes(scene.projector, one)
    assert len(there) >= 4
    steps = [(pose.x - one.belief.pose.x) / STEP_M for pose in there if abs(pose.phi - POSE.phi) < 0.1]
    assert steps[:2] == pytest.approx([round(step) for step in steps[:2]], abs=0.05)
    assert {round(step) for step in steps} >= {-1, 1}
    assert all(0.0 < pose.x < 14.0 and 0.0 < pose.y < 6.0 for pose in there)


def test_a_place_like_no_other_has_no_lookalikes(tmp_path: Path) -> None:
    building = hall([4.0])
    wire_map = building.read(tmp_path)
    pose = Pose2(4.2, 3.4, math.pi / 2)
    segments = extract_segments(
        draw(building.faces, CAMERA, pose, np.random.default_rng(31)), CAMERA, LineConfig()
    )
    lines = measured_lines(segments, CAMERA.focal_px, CONFIG.edge_model_px)
    alone = Scene(Projector(CAMERA, wire_map), np.arange(len(wire_map)), lines)
    one = found_at(alone, pose)
    assert with_lookalikes(alone, one, 0, CONFIG) == one
    assert with_lookalikes(alone, [], 0, CONFIG) == []
