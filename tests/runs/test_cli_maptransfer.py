"""`map import`, `map export` and `init` on the command line."""

from __future__ import annotations

import json

import pytest

from maps.mapfile import read_map
from runs.robot import read_robot

LINES = "0 0 0 4 0 0\n4 0 0 4 3 0\n4 3 0 0 3 0\n0 3 0 0 0 0\n0 0 0 0 0 2.5\n"


@pytest.fixture
def lines(tmp_path):
    path = tmp_path / "lines.txt"
    path.write_text(LINES)
    return path


def test_import_tells_what_it_did_and_writes_a_map(wireloc, lines, tmp_path):
    out = tmp_path / "new" / "map.yaml"
    ended = wireloc("map", "import", lines, "--out", out)
    assert (ended.code, ended.err) == (0, "")
    assert "segments: 5" in ended.out
    assert "guessed: the floor" in ended.out
    assert ended.out.splitlines()[-1] == str(out)
    assert read_map(out).floor.area == pytest.approx(12.0)


def test_import_for_programs(wireloc, lines, tmp_path):
    ended = wireloc("map", "import", lines, "--out", tmp_path / "map.yaml", "--json", "--unit", "m")
    content = json.loads(ended.out)
    assert content["found"]["segments"] == 5
    assert content["guessed"]
    assert content["dropped"] == []


def test_import_does_not_overwrite_unless_told(wireloc, lines, tmp_path):
    out = tmp_path / "map.yaml"
    out.write_text("precious")
    ended = wireloc("map", "import", lines, "--out", out)
    assert (ended.code, out.read_text()) == (2, "precious")
    assert wireloc("map", "import", lines, "--out", out, "--force").code == 0
    assert len(read_map(out)) == 5


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--layer", "WALL"), "--layer: expected NAME="),
        (("--layer", "W=roof"), "--layer: expected NAME="),
        (("--layer", "W=window,2,1"), "--layer: expected NAME="),
        (("--layer", "W=window,nan,inf"), "--layer: expected NAME="),
        (("--unit", "furlong"), "--unit: expected one of"),
        (("--wall-height", "3200"), "--wall-height: expected metres"),
        (("--wall-height", "nan"), "--wall-height: expected metres"),
    ],
)
def test_bad_options(wireloc, lines, tmp_path, options, said):
    ended = wireloc("map", "import", lines, "--out", tmp_path / "map.yaml", *options)
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "map.yaml").exists()


@pytest.mark.parametrize(
    "name", ["nowhere.sdf", "map.docx", "a.sdf", "a.dxf", "a.ifc", "a.yaml", "a.csv", "folder.sdf"]
)
def test_bad_files_end_with_two_in_one_line(wireloc, tmp_path, name):
    path = tmp_path / name
    if name.startswith(("a.", "map")):
        path.write_text("a poem\nof two lines\n")
    elif name == "folder.sdf":
        path.mkdir()
    ended = wireloc("map", "import", path, "--out", tmp_path / "out.yaml")
    assert ended.code == 2
    assert str(path) in ended.err
    assert ended.err.count("\n") == 1
    assert ended.out == ""
    assert not (tmp_path / "out.yaml").exists()


def test_formats_are_known_by_their_content(wireloc, tmp_path):
    path = tmp_path / "house"
    path.write_text("<?xml version='1.0'?><sdf/>")
    assert "no model" in wireloc("map", "import", path, "--out", tmp_path / "map.yaml").err


def test_export(wireloc, lines, tmp_path):
    out = tmp_path / "map.yaml"
    wireloc("map", "import", lines, "--out", out)
    for name in ("plan.svg", "grid.pgm", "copy.yaml"):
        assert wireloc("map", "export", out, "--out", tmp_path / name).code == 0
        assert (tmp_path / name).stat().st_size > 0
    assert (tmp_path / "grid.yaml").exists()
    assert wireloc("map", "export", out, "--out", out).code == 2
    assert wireloc("map", "export", out, "--out", tmp_path / "a.docx").code == 2


def test_init_writes_what_the_readers_read(wireloc, tmp_path):
    folder = tmp_path / "mine"
    ended = wireloc("init", folder)
    assert ended.code == 0
    assert ended.out.split() == [str(folder / "robot.yaml"), str(folder / "map.yaml")]
    robot = read_robot(folder / "robot.yaml")
    assert robot.wheels
    assert robot.camera
    assert robot.start
    wire_map = read_map(folder / "map.yaml")
    assert len(wire_map.floor.geoms) == 1
    assert wire_map.floor.area == pytest.approx(20.0 - 0.16 + 0.18)
    assert robot.start.pose.x > 0.0
    assert (folder / "map.yaml").read_text().count("#") > 10


def test_init_does_not_overwrite(wireloc, tmp_path):
    (tmp_path / "map.yaml").write_text("precious")
    ended = wireloc("init", tmp_path)
    assert ended.code == 2
    assert (tmp_path / "map.yaml").read_text() == "precious"
    assert not (tmp_path / "robot.yaml").exists()
