"""Look-alike poses: found where a hall repeats itself, and only there."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from drawing import CAMERA
from toy_building import hall

from maps.poses import Pose2
from maps.symmetries import symmetries_of
from maps.wiremap import WireMap
from vision.localizability import ExpectationConfig, expected_look
from vision.projection import Projector
from vision.twins import TwinFinder

#: Looking at the panelled wall, y = 6, from so near that a single panel fills much of the view.
AT_PANEL = Pose2(4.65, 3.6, math.pi / 2.0)


def panelled(folder: Path, panels: list[float], length_m: float) -> WireMap:
    """Return a hall with panels that are seen nearly always, so that four edges are evidence enough."""
    wire_map = hall(panels, length_m).read(folder)
    return replace(wire_map, detection_rate=np.full(len(wire_map), 0.9))


def twins_at(wire_map: WireMap, pose: Pose2) -> list[Pose2] | None:
    projector = Projector(CAMERA, wire_map)
    look = expected_look(projector, pose, np.arange(len(wire_map)), ExpectationConfig())
    return TwinFinder(projector, symmetries_of(wire_map)).twins(look)


def test_equal_panels_far_apart_are_mistaken_for_each_other(tmp_path: Path) -> None:
    found = twins_at(panelled(tmp_path, [4.5, 12.5, 20.5], 26.0), AT_PANEL)
    assert found is not None
    assert sorted(round(pose.x, 2) for pose in found) == [12.65, 20.65]
    assert all(abs(pose.y - 3.6) < 0.01 and abs(pose.phi - AT_PANEL.phi) < 0.01 for pose in found)


def test_a_second_panel_in_view_tells_them_apart(tmp_path: Path) -> None:
    found = twins_at(panelled(tmp_path, [4.5, 5.3, 12.5, 20.5], 26.0), AT_PANEL)
    assert found == []


def test_known_bright_sides_tell_apart(tmp_path: Path) -> None:
    wire_map = panelled(tmp_path, [4.5, 12.5], 18.0)
    assert twins_at(wire_map, AT_PANEL)
    other = np.array([1.0 if name.startswith("panel0") else -1.0 for name in wire_map.names])
    other[[not name.startswith("panel") for name in wire_map.names]] = 0.0
    assert twins_at(replace(wire_map, polarity=other), AT_PANEL) == []


def test_a_room_of_its_own_has_no_twin(toy_map: WireMap) -> None:
    assert twins_at(toy_map, Pose2(4.0, 1.5, 0.0)) == []


def test_a_view_of_nothing_is_not_compared(toy_map: WireMap) -> None:
    assert twins_at(toy_map, Pose2(7.7, 3.0, 0.0)) is None
