"""Motions that carry a map onto itself: found where rooms repeat, and nowhere else."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from toy_building import Building, hall

from maps.poses import Pose2
from maps.symmetries import motions_of, symmetries_of
from maps.wiremap import WireMap


def has_motion(wire_map: WireMap, x: float, y: float, phi: float) -> bool:
    found = symmetries_of(wire_map).motions
    away = np.hypot(found[:, 0] - x, found[:, 1] - y)
    turned = np.abs(np.angle(np.exp(1j * (found[:, 2] - phi))))
    return bool(((away < 0.02) & (turned < 0.01)).any())


def two_rooms(tmp_path: Path, turn: float) -> WireMap:
    """Return an irregular room and its copy, turned about the origin and 20 m further."""
    corners = [(0.0, 0.0), (5.0, 0.0), (5.0, 2.0), (3.5, 2.0), (3.5, 4.0), (0.0, 4.0)]
    pose = Pose2(20.0, 0.0, turn)
    copied = [(there.x, there.y) for there in (pose @ Pose2(x, y, 0.0) for x, y in corners)]
    segments = []
    for name, ring in (("here", corners), ("there", copied)):
        for count, (p, q) in enumerate(zip(ring, [*ring[1:], ring[0]], strict=True)):
            segments.append({"name": f"{name}/u{count}", "kind": "corner", "p0": (*p, 0.0), "p1": (*p, 2.7)})
            segments.append({"name": f"{name}/c{count}", "kind": "ceiling", "p0": (*p, 2.7), "p1": (*q, 2.7)})
    floor: list[dict[str, object]] = [{"outer": corners}, {"outer": copied}]
    return Building(segments, floor, [], []).read(tmp_path)


def test_a_turned_copy_of_a_room_is_found(tmp_path: Path) -> None:
    turn = math.pi / 2.0
    wire_map = two_rooms(tmp_path, turn)
    assert has_motion(wire_map, 20.0, 0.0, turn)
    back = Pose2(20.0, 0.0, turn).inverse()
    assert has_motion(wire_map, back.x, back.y, back.phi)


def test_what_the_motion_carries_is_the_room_and_not_more(tmp_path: Path) -> None:
    wire_map = two_rooms(tmp_path, math.pi / 2.0)
    symmetries = symmetries_of(wire_map)
    best = int(np.argmin(np.abs(symmetries.motions - [20.0, 0.0, math.pi / 2.0]).sum(axis=1)))
    here = np.array([name.startswith("here") for name in wire_map.names])
    assert symmetries.carries[best, here].all()
    assert not symmetries.carries[best, ~here].any()


def test_an_irregular_room_alone_has_no_motion_of_all_of_it(tmp_path: Path) -> None:
    wire_map = two_rooms(tmp_path, math.pi / 2.0)
    symmetries = symmetries_of(wire_map)
    here = [row for row, name in enumerate(wire_map.names) if name.startswith("here")]
    whole = symmetries.carries[:, here].all(axis=(1, 2))
    # Onto its copy, and onto nothing else.
    assert whole.sum() == 1


def test_equal_panels_shift_onto_each_other(tmp_path: Path) -> None:
    assert has_motion(hall([2.0, 4.5, 7.0]).read(tmp_path), 2.5, 0.0, 0.0)


def test_standing_still_is_no_motion(tmp_path: Path) -> None:
    symmetries = symmetries_of(hall([2.0, 4.5]).read(tmp_path))
    moves = np.hypot(symmetries.motions[:, 0], symmetries.motions[:, 1])
    assert ((moves > 0.3) | (np.abs(symmetries.motions[:, 2]) > 0.05)).all()


def test_motions_of_some_edges_carry_these(tmp_path: Path) -> None:
    wire_map = two_rooms(tmp_path, math.pi / 2.0)
    here = np.array([row for row, name in enumerate(wire_map.names) if name.startswith("here")])
    motions = motions_of(wire_map, here)
    np.testing.assert_allclose(motions[0], [20.0, 0.0, math.pi / 2.0], atol=0.01)
    # The way back is no motion of these.
    back = Pose2(20.0, 0.0, math.pi / 2.0).inverse()
    away = np.abs(motions - back.as_array())
    assert away.max(axis=1).min() > 0.3
    assert motions_of(wire_map, here[:3]).shape == (0, 3)
