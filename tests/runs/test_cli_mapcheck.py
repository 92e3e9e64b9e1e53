"""`wireloc map check` and `wireloc map show`: what they say, how they end, what they write."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from toy_building import toy_building

import maps.check
import maps.regioncache
from maps.mapfile import read_map
from maps.partition import convex_pieces
from maps.regions import ViewRegions, assemble
from maps.wiremap import WireMap
from runs.mapplan import COUNT_COLOURS, draw_map, picture
from runs.palette import count_colour

Command = Callable[..., Any]


def some_regions(wire_map: WireMap, heights_m: tuple[float, float]) -> ViewRegions:
    """Cut the floor into convex pieces that see 1, 2, 3... segments: quick, and easy to tell apart."""
    pieces = convex_pieces(wire_map.floor)
    rows = [np.arange(number + 1) for number in range(len(pieces))]
    return assemble(
        heights_m,
        corners=np.concatenate(pieces),
        corner_starts=np.cumsum([0, *map(len, pieces)]),
        rows=np.concatenate(rows),
        ranges=np.zeros((sum(map(len, rows)), 2)),
        row_starts=np.cumsum([0, *map(len, rows)]),
        build_seconds=1.5,
    )


@pytest.fixture(autouse=True)
def regions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maps.check, "cached_regions", some_regions)
    monkeypatch.setattr(maps.regioncache, "cached_regions", some_regions)


@pytest.fixture
def content() -> dict[str, Any]:
    built: dict[str, Any] = json.loads(toy_building().text())
    return built


def write(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "house.yaml"
    path.write_text(json.dumps(content))
    return path


def extra(name: str, x: float) -> dict[str, Any]:
    return {"name": name, "kind": "door", "p0": [x, 3, 0], "p1": [x, 3, 2]}


def test_check_of_a_sound_map(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    ended = wireloc("map", "check", write(tmp_path, content))
    assert (ended.code, ended.err) == (0, "")
    assert "0 errors, 0 warnings, 0 notes" in ended.out
    assert "104: 18 ceiling, 18 corner, 20 floor, 48 panel" in ended.out
    for figure in ("219.5 m", "65.4 m2", "built in 1.5 s"):
        assert figure in ended.out
    assert "\x1b" not in ended.out


def test_errors_end_with_one_and_every_finding_is_on_one_line(
    wireloc: Command, tmp_path: Path, content: dict[str, Any]
) -> None:
    content["segments"] += [extra("[bold]/out", -3.0), extra("none", 0.0) | {"p1": [0, 3, 0]}]
    ended = wireloc("map", "check", write(tmp_path, content))
    assert (ended.code, ended.err) == (1, "")
    (line,) = [line for line in ended.out.splitlines() if "[bold]/out" in line]
    assert line.split()[0] == "error"
    assert "outside the building" in line
    assert "3.00 m from the floor" in line
    assert "correct its ends" in line
    assert "segments[105], none" in ended.out
    assert "2 errors, 0 warnings, 0 notes" in ended.out
    assert "not built" in ended.out


def test_warnings_end_with_zero(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    content["segments"][-1]["p1"][2] += 5.0
    ended = wireloc("map", "check", write(tmp_path, content))
    assert ended.code == 0
    assert "0 errors, 1 warning, 0 notes" in ended.out


def test_many_of_one_fault_are_counted(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    content["segments"] += [extra(f"out{number}", -3.0 - number) for number in range(40)]
    ended = wireloc("map", "check", write(tmp_path, content))
    assert "out11" in ended.out
    assert "out12" not in ended.out
    assert "and 28 more" in ended.out
    assert "40 errors" in ended.out


def test_check_for_programs(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    content["segments"] += [extra("out", -3.0)]
    path = write(tmp_path, content)
    ended = wireloc("map", "check", path, "--json")
    said = json.loads(ended.out)
    assert ended.code == 1
    assert (said["map"], said["errors"], said["warnings"], said["notes"]) == (str(path), 1, 0, 0)
    (finding,) = said["findings"]
    assert (finding["severity"], finding["fault"]) == ("error", "outside the building")
    assert finding["where"] == ["out"]
    assert said["figures"]["segments"] == 105
    assert said["figures"]["regions"] is None
    content["segments"].pop()
    sound = json.loads(wireloc("map", "check", write(tmp_path, content), "--json").out)
    assert sound["findings"] == []
    assert sound["figures"]["regions"]["build_s"] == 1.5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "house.yaml: no such file"),
        ("segments: [", "house.yaml: line"),
        ("a poem", "house.yaml: expected keys and values"),
        ("rooms: 3", "house.yaml: segments: not a map"),
    ],
)
@pytest.mark.parametrize("command", ["check", "show"])
def test_no_map(wireloc: Command, tmp_path: Path, command: str, text: str | None, said: str) -> None:
    path = tmp_path / "house.yaml"
    if text is not None:
        path.write_text(text)
    ended = wireloc("map", command, path, *(("--out", tmp_path / "a.png") if command == "show" else ()))
    assert ended.code == 2
    assert ended.err.count("\n") == 1
    assert ended.out == ""
    if command == "check":
        assert said in ended.err
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--out", "a.pdf"), "--out: expected .png, .svg or .rrd, not '.pdf'"),
        (("--out", "nowhere/a.png"), "nowhere/a.png: no such folder"),
        (("--height", "-1"), "--height: expected metres"),
        (("--height", "nan"), "--height: expected metres"),
    ],
)
def test_bad_options(
    wireloc: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    content: dict[str, Any],
    options: tuple[str, str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = wireloc("map", "show", write(tmp_path, content), *options)
    assert ended.code == 2
    assert said in ended.err
    assert [path.name for path in tmp_path.iterdir()] == ["house.yaml"]


def test_show_draws_into_the_current_folder(
    wireloc: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: dict[str, Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maps").mkdir()
    ended = wireloc("map", "show", write(tmp_path / "maps", content))
    assert (ended.code, ended.out, ended.err) == (0, "house.png\n", "")
    assert (tmp_path / "house.png").read_bytes().startswith(b"\x89PNG")


def test_svg_has_every_layer(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    out = tmp_path / "plan.svg"
    assert wireloc("map", "show", write(tmp_path, content), "--out", out).code == 0
    root = ET.parse(out).getroot()
    words = {text.text for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"ceiling", "corner", "floor", "panel", "lintel", "house"} <= words
    assert "segments that can be seen from the region" in words


def test_regions_are_coloured_by_what_they_see(tmp_path: Path) -> None:
    wire_map = toy_building().read(tmp_path)
    found = some_regions(wire_map, (1.0, 1.0))
    figure = draw_map(wire_map, found, "toy")
    picture(figure, ".png")
    cells = figure.axes[0].collections[0]
    assert np.asarray(cells.get_array()).tolist() == list(range(1, len(found) + 1))
    shares = np.arange(1, len(found) + 1) / len(found)
    np.testing.assert_allclose(cells.get_facecolors(), COUNT_COLOURS(shares), atol=0.01)
    # The recording has the same colours, but for rounding.
    mine = np.array([count_colour(share) for share in shares])
    np.testing.assert_allclose(mine, 255 * COUNT_COLOURS(shares)[:, :3], atol=2.5)


def test_recording_has_map_and_regions(wireloc: Command, tmp_path: Path, content: dict[str, Any]) -> None:
    path, out = write(tmp_path, content), tmp_path / "house.rrd"
    ended = wireloc("map", "show", path, "--out", out)
    assert (ended.code, ended.out) == (0, f"{out}\n")
    chunks = RrdReader(out).stream().to_chunks()
    tables = {chunk.entity_path: chunk.to_record_batch() for chunk in chunks}
    kinds = {str(entity).rsplit("/", 1)[1] for entity in tables if "/segments/" in str(entity)}
    assert kinds == {"ceiling", "corner", "floor", "panel"}
    assert {"/world/map/floor", "/world/map/lintels"} <= tables.keys()
    mesh = tables["/world/regions/seen"]
    vertices = np.array(mesh.column("Mesh3D:vertex_positions")[0].as_py())
    triangles = np.array(mesh.column("Mesh3D:triangle_indices")[0].as_py())
    sides = vertices[triangles][:, 1:, :2] - vertices[triangles][:, :1, :2]
    # The triangles cover the floor once, all of them counter-clockwise.
    areas = 0.5 * (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    assert (areas > -1e-9).all()
    assert areas.sum() == pytest.approx(read_map(path).floor.area, rel=1e-4)
    labels = tables["/world/regions/outlines"].column("LineStrips3D:labels")[0].as_py()
    assert labels[:2] == ["region 0: 1 segments", "region 1: 2 segments"]
