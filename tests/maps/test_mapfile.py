"""map.yaml: what is read, and the key that every kind of bad input names."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from toy_building import BOX_M, DOOR_M, RECESS_M, toy_building

from maps.errors import InputError
from maps.floor import SIGHT_MARGIN_M
from maps.mapdocument import DEFAULT_SIGMA_M
from maps.mapfile import read_map
from maps.wiremap import WireMap

SMALL: dict[str, Any] = {
    "units": "m",
    "segments": [
        {"name": "a", "kind": "floor", "p0": [0, 0, 0], "p1": [4, 0, 0]},
        {"name": "b", "kind": "corner", "p0": [0, 0, 0], "p1": [0, 0, 3]},
    ],
    "floor": [
        {
            "outer": [[0, 0], [4, 0], [4, 3], [0, 3]],
            "holes": [[[1, 1], [2, 1], [2, 2], [1, 2]]],
            "hole_tops_m": [0.7],
        }
    ],
    "lintels": [{"name": "l", "p0": [4, 1], "p1": [4, 2], "bottom_m": 2.0}],
}


def read(folder: Path, content: dict[str, Any]) -> WireMap:
    path = folder / "map.yaml"
    path.write_text(json.dumps(content))
    return read_map(path)


def test_toy_building_is_read(toy_map: WireMap) -> None:
    building = toy_building()
    assert len(toy_map) == len(building.segments) == len(toy_map.names) == len(toy_map.kinds)
    row = toy_map.names.index("door/west/high")
    np.testing.assert_array_equal(toy_map.endpoints[row], [[8, 1, DOOR_M], [8, 2, DOOR_M]])
    assert toy_map.kinds[row] == "panel"
    assert toy_map.lintel_bottoms_m.tolist() == [DOOR_M, DOOR_M]
    assert toy_map.lintels.shape == (2, 2, 2)
    # The passage joins both rooms: 8 x 4 + 5 x 3, 3.8 x 5, 0.2 x 1, less pillar and box.
    assert len(toy_map.floor.geoms) == 1
    assert toy_map.floor.area == pytest.approx(47.0 + 19.0 + 0.2 - 0.16 - 0.64)


def test_walls_have_the_floor_on_their_left_and_only_low_ones_have_tops(toy_map: WireMap) -> None:
    middle, way = toy_map.walls.mean(axis=1), toy_map.walls[:, 1] - toy_map.walls[:, 0]
    left = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None]
    assert shapely.contains_xy(toy_map.floor, *(middle + 0.01 * left).T).all()
    assert not shapely.contains_xy(toy_map.floor, *(middle - 0.01 * left).T).any()
    low = np.isfinite(toy_map.wall_tops_m)
    assert low.sum() == 4
    assert (toy_map.wall_tops_m[low] == BOX_M).all()
    assert middle[low].mean(axis=0) == pytest.approx([6.4, 3.0])


def test_sight_points_lie_a_little_inside_the_floor(toy_map: WireMap) -> None:
    sight = shapely.points(toy_map.sight_endpoints[..., :2])
    inner = toy_map.floor.buffer(-SIGHT_MARGIN_M + 1e-6)
    assert shapely.covers(inner, sight).all()
    moved = np.linalg.norm(toy_map.sight_endpoints - toy_map.endpoints, axis=2)
    assert moved.max() < np.hypot(RECESS_M + SIGHT_MARGIN_M, SIGHT_MARGIN_M) + 1e-6
    np.testing.assert_array_equal(toy_map.sight_endpoints[..., 2], toy_map.endpoints[..., 2])


def test_clockwise_outlines_and_overlapping_parts_are_one_floor(tmp_path: Path) -> None:
    content = copy.deepcopy(SMALL)
    content["floor"][0]["outer"].reverse()
    content["floor"].append({"outer": [[3.5, 0], [6, 0], [6, 3], [3.5, 3]]})
    wire_map = read(tmp_path, content)
    assert wire_map.floor.area == pytest.approx(17.0)
    assert not (wire_map.walls[..., 0] == 4.0).all(axis=1).any()


def test_sigma_is_the_segments_or_the_maps_or_a_centimetre(tmp_path: Path) -> None:
    content = copy.deepcopy(SMALL)
    assert read(tmp_path, content).sigma_m.tolist() == [DEFAULT_SIGMA_M] * 2 == [0.01] * 2
    content["sigma_m"] = 0.03
    content["segments"][1] |= {"sigma_m": 0.05, "detection_rate": 0.8, "polarity": -1}
    wire_map = read(tmp_path, content)
    assert wire_map.sigma_m.tolist() == [0.03, 0.05]
    assert np.isnan(wire_map.detection_rate[0])
    assert wire_map.detection_rate[1] == 0.8
    assert wire_map.polarity.tolist() == [0.0, -1.0]


def test_what_may_be_left_out(tmp_path: Path) -> None:
    content = {
        "segments": [{"p0": [0, 0, 0], "p1": [1, 0, 0]}],
        "floor": [{"outer": [[0, 0], [2, 0], [0, 2]]}],
    }
    wire_map = read(tmp_path, content)
    assert wire_map.names == ("segments[0]",)
    assert wire_map.lintels.shape == (0, 2, 2)
    assert wire_map.lintel_bottoms_m.shape == (0,)


def test_arrays_are_read_only(toy_map: WireMap) -> None:
    for name in ("endpoints", "sight_endpoints", "walls", "wall_tops_m", "lintels", "sigma_m", "polarity"):
        assert not getattr(toy_map, name).flags.writeable, name


Change = Callable[[dict[str, Any]], object]
BAD: dict[str, tuple[str, Change]] = {
    "not a number": ("segments[1].p0[2]", lambda m: m["segments"][1]["p0"].__setitem__(2, float("nan"))),
    "infinite": ("segments[0].p1[0]", lambda m: m["segments"][0]["p1"].__setitem__(0, float("inf"))),
    "text": ("segments[0].p1[0]", lambda m: m["segments"][0]["p1"].__setitem__(0, "east")),
    "flat": ("segments[0].p0[2]", lambda m: m["segments"][0].update(p0=[0, 0])),
    "no end": ("segments[0].p1", lambda m: m["segments"][0].pop("p1")),
    "no length": ("segments[1]", lambda m: m["segments"][1].update(p1=[0, 0, 0])),
    "no segments": ("segments", lambda m: m.update(segments=[])),
    "segments missing": ("segments", lambda m: m.pop("segments")),
    "segments not a list": ("segments", lambda m: m.update(segments=3)),
    "floor missing": ("floor", lambda m: m.pop("floor")),
    "floor empty": ("floor", lambda m: m.update(floor=[])),
    "two corners": ("floor[0].outer", lambda m: m["floor"][0].update(outer=[[0, 0], [1, 0]])),
    "two corners of a hole": ("floor[0].holes[0]", lambda m: m["floor"][0].update(holes=[[[0, 0], [1, 0]]])),
    "no area": ("floor", lambda m: m["floor"].__setitem__(0, {"outer": [[0, 0], [1, 0], [2, 0]]})),
    "tops for other holes": ("floor[0]", lambda m: m["floor"][0].update(hole_tops_m=[0.5, 0.6])),
    "misspelt tops": ("floor[0].hole_top_m", lambda m: m["floor"][0].update(hole_top_m=[0.5])),
    "millimetres": ("units", lambda m: m.update(units="mm")),
    "millimetres unsaid": ("segments[0].p1[0]", lambda m: m["segments"][0].update(p1=[4e6, 0, 0])),
    "sigma zero": ("sigma_m", lambda m: m.update(sigma_m=0.0)),
    "sigma negative": ("segments[0].sigma_m", lambda m: m["segments"][0].update(sigma_m=-0.01)),
    "rate": ("segments[0].detection_rate", lambda m: m["segments"][0].update(detection_rate=1.5)),
    "rate not a number": (
        "segments[0].detection_rate",
        lambda m: m["segments"][0].update(detection_rate=float("nan")),
    ),
    "polarity": ("segments[0].polarity", lambda m: m["segments"][0].update(polarity=2)),
    "lintel": ("lintels[0].bottom_m", lambda m: m["lintels"][0].pop("bottom_m")),
}


@pytest.mark.parametrize(("key", "change"), BAD.values(), ids=BAD.keys())
def test_bad_input_names_its_key(tmp_path: Path, key: str, change: Change) -> None:
    content = copy.deepcopy(SMALL)
    read(tmp_path, content)
    change(content)
    text = json.dumps(content).replace("NaN", ".nan").replace("Infinity", ".inf")
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_map(path)
    assert caught.value.where == key
    assert "\n" not in str(caught.value)
