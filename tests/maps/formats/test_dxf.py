"""Drawings: floors and wall bodies, doors in pairs, units, heights, layers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.errors import InputError, MissingExtraError
from maps.formats.dxf import import_dxf
from maps.formats.imported import ImportOptions, LayerKind, LayerRule
from maps.mapfile import build_map

ezdxf = pytest.importorskip("ezdxf")

#: Two rooms joined by a passage in the wall between them; millimetres.
OUTLINE = [
    (0, 0), (4000, 0), (4000, 1000), (4200, 1000), (4200, 0), (8000, 0),
    (8000, 3000), (4200, 3000), (4200, 1900), (4000, 1900), (4000, 3000), (0, 3000),
]  # fmt: skip
DOORS = [((3985, 1000), (3985, 1900)), ((4215, 1900), (4215, 1000))]


def drawing(
    path, unit=4, walls=(OUTLINE,), doors=DOORS, windows=(((1000, 0), (2200, 0)),), text="", scale=1.0
):
    document = ezdxf.new(units=unit)
    space = document.modelspace()
    for wall in walls:
        space.add_lwpolyline(np.multiply(wall, scale).tolist(), close=True, dxfattribs={"layer": "A-WALL"})
    for layer, lines in (("Doors", doors), ("WINDOW", windows)):
        for p, q in lines:
            space.add_line(
                np.multiply(p, scale).tolist(), np.multiply(q, scale).tolist(), dxfattribs={"layer": layer}
            )
    if text:
        space.add_text(text)
    space.add_circle((0, 0), 1, dxfattribs={"layer": "A-WALL"})
    document.layers.add("A-WALL")
    document.saveas(path)
    return path


def test_an_outline_of_the_floor_with_a_passage(tmp_path):
    result = import_dxf(drawing(tmp_path / "a.dxf"), ImportOptions(wall_height_m=3.0))
    wire_map = build_map(result.document, tmp_path)
    assert wire_map.floor.area == pytest.approx(12.0 + 11.4 + 0.18)
    found = result.report.found
    assert (found["rooms"], found["passages"], found["doors"], found["windows"]) == (2, 1, 1, 1)
    lintels = {(round(v.p0[0], 3), v.bottom_m) for v in result.document.lintels}
    assert lintels == {(4.0, 2.05), (4.2, 2.05)}
    # The frames are where they are drawn, 15 mm in front of the wall; the wall's ceiling runs on over them.
    jambs = [s for s in result.document.segments if s.kind == "door" and s.p0[2] != s.p1[2]]
    assert {round(s.p0[0], 3) for s in jambs} == {3.985, 4.215}
    over = [s for s in result.document.segments if s.kind == "ceiling" and s.p0[0] == s.p1[0] == 4.0]
    assert [math.dist(s.p0, s.p1) for s in over] == pytest.approx([3.0])
    assert any("CIRCLE on layer A-WALL" in sentence for sentence in result.report.dropped)


def test_bodies_of_walls_enclose_the_same_rooms(tmp_path):
    outer = [(-200, -200), (8200, -200), (8200, 3200), (-200, 3200)]
    east = [(4200, 0), (8000, 0), (8000, 3000), (4200, 3000)]
    west = [(0, 0), (4000, 0), (4000, 3000), (0, 3000)]
    path = drawing(tmp_path / "a.dxf", walls=(outer, east, west))
    result = import_dxf(path, ImportOptions(wall_height_m=3.0))
    assert any("bodies of walls" in sentence for sentence in result.report.guessed)
    # The wall between the rooms is drawn in one piece; the doors on it open it.
    assert result.report.found["floor_area_m2"] == pytest.approx(12.0 + 11.4 + 0.18, abs=0.01)
    assert {lintel.bottom_m for lintel in result.document.lintels} == {2.05}


def test_wall_bodies_with_a_gap_for_the_door(tmp_path):
    walls = [
        [(-200, -200), (8200, -200), (8200, 0), (-200, 0)],
        [(-200, 3000), (8200, 3000), (8200, 3200), (-200, 3200)],
        [(-200, 0), (0, 0), (0, 3000), (-200, 3000)],
        [(8000, 0), (8200, 0), (8200, 3000), (8000, 3000)],
        [(4000, 0), (4200, 0), (4200, 1000), (4000, 1000)],
        [(4000, 1900), (4200, 1900), (4200, 3000), (4000, 3000)],
    ]
    result = import_dxf(drawing(tmp_path / "a.dxf", walls=walls), ImportOptions(wall_height_m=3.0))
    wire_map = build_map(result.document, tmp_path)
    assert wire_map.floor.area == pytest.approx(12.0 + 11.4 + 0.18, abs=0.01)
    assert (result.report.found["rooms"], result.report.found["passages"]) == (2, 1)
    assert len(result.document.lintels) == 2


@pytest.mark.parametrize(("unit", "scale"), [(6, 1e-3), (5, 0.1), (1, 1 / 25.4), (0, 1.0), (0, 1e-3)])
def test_units(tmp_path, unit, scale):
    result = import_dxf(drawing(tmp_path / "a.dxf", unit=unit, scale=scale), ImportOptions())
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(23.58, abs=0.01)
    assert any("unit" in sentence for sentence in result.report.guessed) == (unit == 0)


def test_the_height_is_told_or_read_or_guessed(tmp_path):
    def top(text, told):
        result = import_dxf(drawing(tmp_path / "a.dxf", text=text), ImportOptions(wall_height_m=told))
        ceilings = [s for s in result.document.segments if s.kind == "ceiling"]
        return ceilings[0].p0[2], ceilings[0].sigma_m, result.report.guessed[0]

    assert top("CEILING 3200", 2.8)[:2] == (2.8, None)
    assert top("CEILING 3200", None)[:2] == (3.2, None)
    height_m, sigma_m, said = top("", None)
    assert (height_m, sigma_m) == (2.5, 0.1)
    assert "--wall-height" in said


def test_layers_and_their_heights_are_told(tmp_path):
    rules = {
        "a-wall": LayerRule(LayerKind.WALL),
        "WINDOW": LayerRule(LayerKind.WINDOW, 0.5, 1.7),
        "Doors": LayerRule(LayerKind.IGNORE),
    }
    result = import_dxf(drawing(tmp_path / "a.dxf"), ImportOptions(layers=rules))
    windows = [s for s in result.document.segments if s.kind == "window"]
    assert {z for s in windows for z in (s.p0[2], s.p1[2])} == {0.5, 1.7}
    assert all(s.sigma_m is None for s in windows)
    assert not [s for s in result.document.segments if s.kind == "door"]
    with pytest.raises(InputError, match="layer ROOF: no such layer"):
        import_dxf(tmp_path / "a.dxf", ImportOptions(layers={"ROOF": LayerRule(LayerKind.WALL)}))


def test_missing_library_is_told_with_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ezdxf", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'wireloc\[maps\]'"):
        import_dxf(tmp_path / "a.dxf", ImportOptions())


@pytest.mark.parametrize("content", [b"", b"poem", b"0\nSECTION\n2\nENTITIES\n0\nLINE\n", b"\x00\xff" * 50])
def test_nonsense_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "a.dxf"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        import_dxf(path, ImportOptions())
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_drawing_without_walls_names_its_layers(tmp_path):
    with pytest.raises(InputError, match=r"--layer NAME=wall.*Doors|--layer NAME=wall.*A-WALL"):
        import_dxf(drawing(tmp_path / "a.dxf", walls=()), ImportOptions())
