"""`wireloc map coverage`: what it says, how it ends, what it writes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from toy_building import toy_building

from maps.mapfile import read_map
from runs.cli_mapcoverage import content_of
from runs.coverage import Coverage, places_on
from runs.coverageplan import LIMITS_M, sigma_class

Command = Callable[..., Any]

ROBOT = """\
camera:
  model: pinhole_radtan (OpenCV)
  width: 640
  height: 480
  fx: 540.0
  fy: 540.0
  cx: 322.0
  cy: 238.0
  distortion_k1_k2_p1_p2_k3: [0, 0, 0, 0, 0]
  mount: {x_m: 0.1, y_m: 0.0, height_m: 1.2, pitch_down_rad: 0.08, yaw_rad: 0.0, roll_rad: 0.0}
"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "house.yaml").write_text(toy_building().text())
    (tmp_path / "robot.yaml").write_text(ROBOT)
    return tmp_path / "house.yaml", tmp_path / "robot.yaml"


def test_json_has_every_place_and_heading(wireloc: Command, files: tuple[Path, Path]) -> None:
    house, robot = files
    ended = wireloc("map", "coverage", house, "--robot", robot, "--cell", 2, "--headings", 4, "--json")
    assert ended.code == 0
    content = json.loads(ended.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert content["cell_m"] == 2.0
    places = places_on(read_map(house), 2.0)
    assert [[cell["x"], cell["y"]] for cell in content["cells"]] == places.tolist()
    for cell in content["cells"]:
        assert [round(heading["phi"], 3) for heading in cell["headings"]] == [0.0, 1.571, 3.142, -1.571]
        for heading in cell["headings"]:
            assert heading.keys() == {"phi", "segments", "sigma_m", "sigma_phi", "lookalikes"}
            major, minor = heading["sigma_m"]
            assert major is None or 0.0 < minor <= major
            if heading["segments"] == 0:
                assert (major, minor, heading["sigma_phi"]) == (None, None, None)
    known = [h["sigma_m"][0] for cell in content["cells"] for h in cell["headings"] if h["sigma_m"][0]]
    assert min(known) < 0.05


def test_it_tells_shares_and_writes_its_files(
    wireloc: Command, files: tuple[Path, Path], tmp_path: Path
) -> None:
    house, robot = files
    out = tmp_path / "cover"
    ended = wireloc("map", "coverage", house, "--robot", robot, "--cell", 2, "--headings", 2, "--out", out)
    assert ended.code == 0
    assert "position better than 0.05 m" in ended.out
    assert "worst places" in ended.out
    assert json.loads((out / "coverage.json").read_text())["cell_m"] == 2.0
    assert (out / "coverage.png").read_bytes().startswith(b"\x89PNG")
    logged = {str(chunk.entity_path) for chunk in RrdReader(out / "coverage.rrd").stream().to_chunks()}
    assert {"/world/coverage/best", "/world/coverage/headings", "/world/map/floor"} <= logged


def test_what_is_not_constrained_is_null() -> None:
    coverage = Coverage(
        cell_m=1.0,
        places=np.array([[0.5, 0.5]]),
        headings=np.array([0.0]),
        segments=np.array([[2]]),
        sigma_m=np.array([[[math.inf, 0.02]]]),
        sigma_phi=np.array([[math.inf]]),
        twins=np.array([[math.nan]]),
        twin_of=np.zeros((0, 2), np.int64),
        twin_poses=np.zeros((0, 3)),
    )
    heading = content_of(coverage)["cells"][0]["headings"][0]
    assert heading == {
        "phi": 0.0,
        "segments": 2,
        "sigma_m": [None, 0.02],
        "sigma_phi": None,
        "lookalikes": None,
    }


def test_places_lie_on_the_floor_and_on_one_grid(files: tuple[Path, Path]) -> None:
    places = places_on(read_map(files[0]), 0.5)
    # The L of 8 x 4 and 5 x 3 m less the pillar and the box, the second room of 3.8 x 5 m, the passage.
    area_m2 = 32.0 + 15.0 - 0.16 - 0.64 + 19.0 + 0.2
    assert len(places) * 0.25 == pytest.approx(area_m2, abs=2.0)
    assert np.allclose((places / 0.5 - 0.5) % 1.0 % 1.0, 0.0)


def test_classes_follow_the_limits() -> None:
    assert sigma_class(np.array([0.001, 0.03, 0.1, 2.0, math.inf])).tolist() == [0, 1, 2, 3, len(LIMITS_M)]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--cell", 0), "--cell: expected 0.05 to 10 m, not 0"),
        (("--cell", "nan"), "--cell: expected"),
        (("--headings", 0), "--headings: expected 1 to 360, not 0"),
    ],
)
def test_bad_options_are_told_in_one_line(
    wireloc: Command, files: tuple[Path, Path], options: tuple[object, ...], said: str
) -> None:
    house, robot = files
    ended = wireloc("map", "coverage", house, "--robot", robot, *options)
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1


def test_bad_files_are_told_in_one_line(wireloc: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    house, robot = files
    blind = tmp_path / "blind.yaml"
    blind.write_text("wheels: {radius_m: 0.05, baseline_m: 0.4}\n")
    for arguments, said in (
        ((house, "--robot", blind), "blind.yaml: camera: missing"),
        ((house, "--robot", tmp_path / "none.yaml"), "none.yaml: no such file"),
        ((tmp_path / "none.yaml", "--robot", robot), "none.yaml: no such file"),
        ((house, "--robot", robot, "--out", house), "is not a folder"),
    ):
        ended = wireloc("map", "coverage", *arguments)
        assert ended.code == 2
        assert said in ended.err
        assert ended.err.count("\n") == 1
