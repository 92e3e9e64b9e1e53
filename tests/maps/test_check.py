"""The examination of a map: every fault put into a sound map is found, named, and nothing else is."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from toy_building import toy_building

import maps.check
from maps.check import MapCheck, check_map
from maps.errors import InputError
from maps.findings import Fault, Finding, Severity
from maps.mapdocument import MapDocument
from maps.mapfile import build_map
from maps.regions import ViewRegions, build_regions
from maps.wiremap import WireMap

HEIGHTS_M = (1.0, 1.0)
Content = dict[str, Any]


@pytest.fixture(autouse=True)
def regions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare the tests the seconds that regions take: none of the findings rests on them."""

    def one_room(_wire_map: WireMap, heights_m: tuple[float, float]) -> ViewRegions:
        return build_regions(square_map, heights_m)

    square_map = _square()
    monkeypatch.setattr(maps.check, "cached_regions", one_room)


def _square() -> WireMap:
    segment = {"p0": [0, 0, 0], "p1": [0, 0, 3]}
    floor = {"outer": [[0, 0], [4, 0], [4, 4], [0, 4]]}
    return build_map(MapDocument.model_validate({"segments": [segment], "floor": [floor]}), Path("square"))


@pytest.fixture(scope="module")
def sound() -> Content:
    content: Content = json.loads(toy_building().text())
    return content


def check(folder: Path, content: Content) -> MapCheck:
    path = folder / "map.yaml"
    path.write_text(json.dumps(content).replace("NaN", ".nan").replace("Infinity", ".inf"))
    return check_map(path, HEIGHTS_M)


def edge(name: str, p0: list[float], p1: list[float], kind: str = "panel") -> Content:
    return {"name": name, "kind": kind, "p0": p0, "p1": p1}


def test_sound_map_has_no_findings_but_figures(tmp_path: Path, sound: Content) -> None:
    checked = check(tmp_path, sound)
    assert checked.findings == ()
    figures = checked.figures
    assert figures is not None
    assert figures.segments == len(sound["segments"]) == sum(figures.kinds.values())
    assert figures.kinds["corner"] == 18
    assert figures.floor_m2 == pytest.approx(65.4)
    assert figures.rooms == 2
    assert figures.length_m == pytest.approx(219.5)
    assert figures.regions is not None
    assert figures.regions.count == 1
    assert figures.regions.memory_bytes > 0


def lintel(name: str, p0: list[float], p1: list[float], bottom_m: float = 2.1) -> Content:
    return {"name": name, "p0": p0, "p1": p1, "bottom_m": bottom_m}


def add(*segments: Content) -> Callable[[Content], object]:
    return lambda content: content["segments"].extend(copy.deepcopy(segments))


def hang(*lintels: Content) -> Callable[[Content], object]:
    return lambda content: content["lintels"].extend(copy.deepcopy(lintels))


def upright(x: float, y: float, name: str = "new") -> Content:
    return edge(name, [x, y, 0.0], [x, y, 3.0])


ERROR, WARNING, NOTE = Severity

#: What is done to the sound map, and what must be found then: (severity, fault, where).
FAULTS: dict[str, tuple[Severity, Fault, tuple[str, ...], Callable[[Content], object]]] = {
    "a speck": (WARNING, Fault.TOO_SHORT, ("new",), add(edge("new", [0, 6.5, 1], [0, 6.5, 1.02]))),
    "twice": (
        ERROR,
        Fault.DOUBLED,
        ("notice/low", "new"),
        add(edge("new", [0.002, 6, 0.9], [0.002, 4.6, 0.9])),
    ),
    "twice, backwards, 3 mm off": (
        ERROR,
        Fault.DOUBLED,
        ("notice/low", "new"),
        add(edge("new", [0.002, 4.603, 0.9], [0.002, 6, 0.9])),
    ),
    "sill on a window's bottom": (
        WARNING,
        Fault.DOUBLED,
        ("window/low", "sill"),
        add(edge("sill", [2, 0, 0.9], [4, 0, 0.9], "sill")),
    ),
    "on one line": (
        WARNING,
        Fault.OVERLAPPING,
        ("notice/low", "new"),
        add(edge("new", [0.002, 5, 0.9], [0.002, 4, 0.9])),
    ),
    "outside": (ERROR, Fault.OUTSIDE, ("new",), add(upright(-0.7, 3))),
    "half outside": (ERROR, Fault.OUTSIDE, ("new",), add(edge("new", [0, 6.5, 1], [-2, 6.5, 1]))),
    "through solid": (ERROR, Fault.OUTSIDE, ("new",), add(edge("new", [5, 6.5, 1], [8.2, 3.9, 1]))),
    "in the air": (WARNING, Fault.FLOATING, ("new",), add(edge("new", [2, 4, 1.0], [2, 5, 1.2]))),
    "under the floor": (ERROR, Fault.BELOW_FLOOR, ("new",), add(edge("new", [0, 6.5, -0.4], [0, 6.5, 1]))),
    "above the ceiling": (
        WARNING,
        Fault.ABOVE_CEILING,
        ("new",),
        add(edge("new", [0, 6.4, 0], [0, 6.4, 3.3])),
    ),
    "a tower": (WARNING, Fault.UNITS, ("new",), add(edge("new", [-0.2, 6.4, 0], [-0.2, 6.4, 2100]))),
    "a name twice": (NOTE, Fault.SAME_NAME, ("new",), add(upright(0, 4, "new"), upright(0, 6.4, "new"))),
    "lintel on a wall": (WARNING, Fault.LINTEL, ("new",), hang(lintel("new", [0, 4], [0, 5]))),
    "lintel in a room": (WARNING, Fault.LINTEL, ("new",), hang(lintel("new", [2, 4], [3, 4]))),
    "lintel down to the knee": (
        WARNING,
        Fault.LINTEL,
        ("new",),
        hang(lintel("new", [8.1, 1], [8.1, 2], 0.3)),
    ),
    "lintel without length": (WARNING, Fault.LINTEL, ("new",), hang(lintel("new", [8.1, 1], [8.1, 1]))),
    "crossed floor": (
        ERROR,
        Fault.FLOOR_SHAPE,
        ("floor[2]",),
        lambda m: m["floor"][2].update(outer=[[8.2, -1], [12, -1], [8.2, 4], [12, 4]]),
    ),
    "hole outside": (
        ERROR,
        Fault.FLOOR_SHAPE,
        ("floor[2]",),
        lambda m: m["floor"][2].update(holes=[[[20, 1], [21, 1], [21, 2]]]),
    ),
    "flat floor": (
        ERROR,
        Fault.FLOOR_SHAPE,
        ("floor[3]",),
        lambda m: m["floor"].append({"outer": [[1, 1], [2, 1], [3, 1]]}),
    ),
    "island": (
        WARNING,
        Fault.UNREACHABLE,
        ("floor",),
        lambda m: m["floor"].append({"outer": [[20, 0], [23, 0], [23, 3], [20, 3]]}),
    ),
    "bare room": (
        WARNING,
        Fault.NO_VERTICAL,
        ("room at (21.5, 1.5)",),
        lambda m: m["floor"].append({"outer": [[20, 0], [23, 0], [23, 3], [20, 3]]}),
    ),
    "not a number": (
        ERROR,
        Fault.REFUSED,
        ("segments[104].p0[2]", "new"),
        add(edge("new", [0, 4, float("nan")], [0, 4, 2])),
    ),
    "no length": (ERROR, Fault.REFUSED, ("segments[104]", "new"), add(edge("new", [0, 4, 1], [0, 4, 1]))),
    "other units": (ERROR, Fault.REFUSED, ("units",), lambda m: m.update(units="mm")),
    "tops for other holes": (
        ERROR,
        Fault.REFUSED,
        ("floor[0]",),
        lambda m: m["floor"][0].update(hole_tops_m=[None]),
    ),
    "misspelt holes": (
        ERROR,
        Fault.REFUSED,
        ("floor[1].hole",),
        lambda m: m["floor"][1].update(hole=[]),
    ),
    "lintels a number": (ERROR, Fault.REFUSED, ("lintels",), lambda m: m.update(lintels=3)),
}


def concise(findings: tuple[Finding, ...]) -> list[tuple[Severity, Fault, tuple[str, ...]]]:
    return [(finding.severity, finding.fault, finding.where) for finding in findings]


@pytest.mark.parametrize(("severity", "fault", "where", "change"), FAULTS.values(), ids=FAULTS.keys())
def test_fault_is_found_and_named(
    tmp_path: Path,
    sound: Content,
    severity: Severity,
    fault: Fault,
    where: tuple[str, ...],
    change: Callable[[Content], object],
) -> None:
    content = copy.deepcopy(sound)
    change(content)
    checked = check(tmp_path, content)
    assert (severity, fault, where) in concise(checked.findings)
    errors = [finding for finding in checked.findings if finding.severity is ERROR]
    assert [finding.fault for finding in errors] == [fault] * (severity is ERROR)
    assert checked.figures is not None
    assert (checked.figures.regions is None) == (severity is ERROR)


def test_all_faults_are_told_at_once(tmp_path: Path, sound: Content) -> None:
    content = copy.deepcopy(sound)
    kept = (
        "a speck",
        "twice",
        "outside",
        "under the floor",
        "lintel on a wall",
        "crossed floor",
        "no length",
    )
    for row, name in enumerate(kept):
        FAULTS[name][3](content)
        for entry in (content["segments"][-1], content["lintels"][-1]):
            entry["name"] = entry["name"].replace("new", f"new{row}")
    checked = check(tmp_path, content)
    assert {FAULTS[name][1] for name in kept} <= {finding.fault for finding in checked.findings}
    order = [finding.severity for finding in checked.findings]
    assert order == sorted(order, key=list(Severity).index)
    assert checked.count(ERROR) == order.count(ERROR) == 5


def test_what_is_meant_is_not_found(tmp_path: Path, sound: Content) -> None:
    content = copy.deepcopy(sound)
    content["floor"][2] |= {"holes": [[[9.2, 0.5], [11, 0.5], [11, 2.5], [9.2, 2.5]]], "hole_tops_m": [0.75]}
    content["segments"] += [
        edge("on the wide table", [10.0, 1.5, 0.75], [10.2, 1.5, 0.75]),
        edge("sash", [2, -0.3, 1], [3, -0.3, 1]),
        edge("lamp", [2, 4, 2.4], [2, 5, 2.4]),
        edge("mark", [2, 4, 0.0], [2, 5, 0.0]),
        edge("post", [2, 5, 0.0], [2, 5, 1.1]),
        edge("on the box", [6.4, 2.8, 0.75], [6.4, 3.2, 0.75]),
        edge("5 cm beside", [0.002, 6, 0.95], [0.002, 4.6, 0.95]),
        edge("end to end", [0.002, 6, 0.9], [0.002, 6.5, 0.9]),
        edge("unheard-of", [0.002, 3, 1], [0.002, 3, 2], "xyzzy"),
    ]
    assert check(tmp_path, content).findings == ()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_other_units(tmp_path: Path, sound: Content, scale: float) -> None:
    content = copy.deepcopy(sound)
    content["lintels"] = []
    for segment in content["segments"]:
        segment.update({end: [scale * value for value in segment[end]] for end in ("p0", "p1")})
    for part in content["floor"]:
        for ring in [part["outer"], *part.get("holes", [])]:
            ring[:] = [[scale * x, scale * y] for x, y in ring]
    checked = check(tmp_path, content)
    assert concise(checked.findings) == [(ERROR, Fault.UNITS, ("floor",))]
    assert checked.figures is not None


@pytest.mark.parametrize(
    ("content", "where"),
    [
        ({"segments": [], "floor": [{"outer": [[0, 0], [4, 0], [4, 4]]}]}, [("segments",)]),
        ({"segments": [7], "floor": [{"outer": 3}]}, [("segments[0]",), ("floor[0].outer",)]),
        ({"segments": [edge("a", [0, 0, 0], [0, 0, 3])], "floor": []}, [("floor",)]),
    ],
)
def test_map_with_nothing_sound_in_it(tmp_path: Path, content: Content, where: list[tuple[str, ...]]) -> None:
    checked = check(tmp_path, content)
    assert [finding.where for finding in checked.findings] == where
    assert checked.figures is None
    assert checked.count(ERROR) == len(where)


@pytest.mark.parametrize("content", [{}, {"segments": []}, {"segments": 3, "floor": []}, {"floor": [1]}])
def test_no_map_at_all(tmp_path: Path, content: Content) -> None:
    with pytest.raises(InputError, match="not a map"):
        check(tmp_path, content)


def test_development_maps_have_no_errors(data: Path) -> None:
    paths = sorted(data.glob("rendered/*/map.yaml"))
    assert paths
    for path in paths:
        checked = check_map(path, HEIGHTS_M)
        assert {finding.fault for finding in checked.findings} <= {Fault.LOOK_ALIKE}, path
        assert checked.figures is not None
        assert checked.figures.rooms >= 5
