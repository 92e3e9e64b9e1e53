"""Gazebo models: boxes, nested poses, parts over doors and under windows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.errors import InputError
from maps.formats.imported import ImportOptions
from maps.formats.sdf import import_sdf
from maps.mapfile import build_map


def box(name, x, y, z, sx, sy, sz, yaw=0.0):
    """A box's collision, its pose in the link."""
    return (
        f"<collision name='{name}'><pose>{x} {y} {z} 0 0 {yaw}</pose>"
        f"<geometry><box><size>{sx} {sy} {sz}</size></box></geometry></collision>"
    )


def link(name, pose, *content):
    return f"<link name='{name}'><pose>{pose}</pose>{''.join(content)}</link>"


def house(extra="", model_pose="0 0 0 0 0 0"):
    """Two rooms of 4 x 3 m beside each other, 2.4 m high; a door between, a window in the south."""
    links = [
        link("south", "0 0 0 0 0 0",
             box("under", 4.1, -0.1, 0.45, 8.6, 0.2, 0.9),
             box("west", 0.4, -0.1, 1.65, 1.2, 0.2, 1.5),
             box("east", 5.1, -0.1, 1.65, 6.6, 0.2, 1.5),
             box("over", 1.4, -0.1, 2.25, 0.8, 0.2, 0.3)),
        link("north", "4.1 3.1 1.2 0 0 3.14159265358979", box("c", 0, 0, 0, 8.6, 0.2, 2.4)),
        # Turned by a quarter: the wall runs along the link's x.
        link("west", "-0.1 1.5 0 0 0 1.5707963267949", box("c", 0, 0, 1.2, 3.0, 0.2, 2.4)),
        link("east", "8.3 1.5 0 0 0 1.5707963267949", box("c", 0, 0, 1.2, 3.0, 0.2, 2.4)),
        link("middle", "4.1 0 0 0 0 0",
             box("a", 0, 0.5, 1.2, 0.2, 1.0, 2.4), box("b", 0, 2.45, 1.2, 0.2, 1.1, 2.4),
             box("over", 0, 1.45, 2.2, 0.2, 0.9, 0.4)),
    ]  # fmt: skip
    return (
        f"<?xml version='1.0'?><sdf version='1.6'><model name='house'><pose>{model_pose}</pose>"
        f"<static>1</static>{''.join(links)}{extra}</model></sdf>"
    )


def imported(folder, text, options=ImportOptions()):  # noqa: B008
    path = folder / "house.sdf"
    path.write_text(text)
    return import_sdf(path, options)


def by_name(result, part):
    return [segment for segment in result.document.segments if part in segment.name]


def test_two_rooms_with_a_door_and_a_window(tmp_path):
    result = imported(tmp_path, house())
    wire_map = build_map(result.document, tmp_path)
    assert wire_map.floor.area == pytest.approx(24.0 + 0.2 * 0.9, abs=0.01)
    assert len(wire_map.floor.geoms) == 1
    assert result.report.found["rooms"] == 2
    assert result.report.found["passages"] == 1
    heads = by_name(result, "middle/door/head")
    assert sorted({round(end[0], 3) for head in heads for end in (head.p0, head.p1)}) == [4.0, 4.2]
    assert all(head.p0[2] == head.p1[2] == 2.0 for head in heads)
    assert {lintel.bottom_m for lintel in result.document.lintels} == {2.0}
    window = np.array([[s.p0, s.p1] for s in result.document.segments if s.kind == "window"])
    assert len(window) == 4
    np.testing.assert_allclose(window.min(axis=(0, 1)), [1.0, 0.0, 0.9], atol=2e-3)
    np.testing.assert_allclose(window.max(axis=(0, 1)), [1.8, 0.0, 2.1], atol=2e-3)


def test_walls_give_floor_ceiling_and_corner_edges_with_unique_names(tmp_path):
    segments = imported(tmp_path, house()).document.segments
    assert len({segment.name for segment in segments}) == len(segments)
    corners = {tuple(np.round(s.p0[:2], 2)) for s in segments if s.kind == "corner"}
    assert corners == {(x, y) for x in (0.0, 4.0, 4.2, 8.2) for y in (0.0, 3.0)}
    ceilings = [s for s in segments if s.kind == "ceiling"]
    assert len(ceilings) == 8  # in line with each other, but not touching
    assert all(s.p0[2] == 2.4 for s in ceilings)
    total = sum(math.dist(s.p0, s.p1) for s in segments if s.kind == "floor")
    assert total == pytest.approx(2 * 14.0 - 2 * 0.9, abs=0.02)


def test_a_models_pose_moves_everything(tmp_path):
    plain = imported(tmp_path, house())
    turned = imported(tmp_path, house(model_pose="10 -5 0 0 0 0.7"))
    assert len(turned.document.segments) == len(plain.document.segments)
    wire_map = build_map(turned.document, tmp_path)
    assert wire_map.floor.area == pytest.approx(24.18, abs=0.02)
    cos, sin = math.cos(0.7), math.sin(0.7)
    corner = np.array([cos * 4.0 - sin * 3.0 + 10.0, sin * 4.0 + cos * 3.0 - 5.0])
    ends = np.array([s.p0[:2] for s in turned.document.segments if s.kind == "corner"])
    assert np.linalg.norm(ends - corner, axis=1).min() < 3e-3


def test_what_is_no_upright_box_is_left_out_and_said(tmp_path):
    extra = (
        "<link name='x'><pose>2 1 1 0.3 0 0</pose>" + box("c", 0, 0, 0, 1, 1, 1) + "</link>"
        "<link name='y'><collision name='c'><geometry><mesh/></geometry></collision></link>"
        "<model name='sofa'><link name='l'>" + box("c", 0, 0, 0.5, 1, 1, 1) + "</link></model>"
    )
    result = imported(tmp_path, house(extra))
    assert result.document == imported(tmp_path, house()).document
    said = " ".join(result.report.dropped)
    for word in ("tilted boxes: 1", "(mesh): 1", "furniture): 1"):
        assert word in said


def test_a_low_wall_can_be_looked_over(tmp_path):
    extra = link("low", "2 1.5 0 0 0 0", box("c", 0, 0, 0.4, 1.0, 0.2, 0.8))
    result = imported(tmp_path, house(extra))
    wire_map = build_map(result.document, tmp_path)
    low = np.isfinite(wire_map.wall_tops_m)
    assert low.sum() == 4
    assert set(wire_map.wall_tops_m[low]) == {0.8}
    tops = [s for s in by_name(result, "low/low") if s.p0[2] == s.p1[2] == 0.8]
    assert len(tops) == 4
    assert not any(
        s.kind == "ceiling" and 1.0 < s.p0[0] < 3.0 and 1.0 < s.p0[1] < 2.0 for s in by_name(result, "")
    )


def test_an_open_doorway_without_a_lintel_closes_the_building_but_is_no_wall(tmp_path):
    # Without the middle wall's lintel the rooms are one; without a piece of the east wall it is still a room.
    text = house().replace(box("over", 0, 1.45, 2.2, 0.2, 0.9, 0.4), "")
    text = text.replace(
        link("east", "8.3 1.5 0 0 0 1.5707963267949", box("c", 0, 0, 1.2, 3.0, 0.2, 2.4)),
        link("east", "8.3 1 0 0 0 1.5707963267949", box("c", 0, 0, 1.2, 2.0, 0.2, 2.4)),
    )
    result = imported(tmp_path, text)
    assert (result.report.found["rooms"], result.report.found["open_sides"]) == (1, 1)
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(24.18, abs=0.01)
    open_side = [
        s for s in result.document.segments if s.p0[0] == s.p1[0] == 8.2 and s.kind in ("floor", "ceiling")
    ]
    assert all(max(s.p0[1], s.p1[1]) <= 2.01 for s in open_side)
    assert open_side


def test_walls_that_enclose_nothing_give_their_hull_and_say_so(tmp_path):
    walls = [
        link("a", "0 0 0 0 0 0", box("c", 0, 0, 1, 9, 0.2, 2)),
        link("b", "0 6 0 0 0 0", box("c", 0, 0, 1, 9, 0.2, 2)),
    ]
    text = f"<sdf version='1.6'><model name='m'><static>1</static>{''.join(walls)}</model></sdf>"
    result = imported(tmp_path, text)
    assert any("hull" in sentence for sentence in result.report.guessed)
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(9.0 * 5.8, abs=0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not XML"),
        ("<sdf><model>", "not XML"),
        ("<html/>", "no <sdf>"),
        ("<sdf/>", "no model"),
        ("<sdf><model name='m'/></sdf>", "no upright box"),
        ("<!DOCTYPE x [<!ENTITY a 'aaaa'>]><sdf>&a;</sdf>", "declarations"),
        (house().replace("8.6 0.2 2.4", "8.6 wide 2.4"), "<size> is not 3 numbers"),
        (house().replace("8.6 0.2 2.4", "8.6 -1 2.4"), "<size> is not above zero"),
        (house(model_pose="1 2 nan 0 0 0"), "<pose> is not 6 numbers"),
        (house().replace("<pose>4.1 3.1", "<pose relative_to='x'>4.1 3.1"), "relative"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(InputError) as caught:
        imported(tmp_path, text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "house.sdf" in str(caught.value)
