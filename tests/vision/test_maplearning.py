"""Learning from drawn pictures: which side is bright, how often edges show, what is missing and what moved."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from drawing import CAMERA, draw, segments_at
from toy_building import PANELS, Face, toy_building

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.lines import extract_segments
from vision.maplearning import Fault, LearningConfig, LearntMap, learn
from vision.mapsightings import SightingConfig, Sightings, sightings_of
from vision.projection import Projector


def towards(target: tuple[float, float], place: tuple[float, float]) -> Pose2:
    return Pose2(*place, math.atan2(target[1] - place[1], target[0] - place[0]))


#: Looking at the board on the south wall, then at the poster on the north wall, from different places.
POSES = tuple(
    [towards((5.9, 0.3), (4.0 + 0.12 * k, 3.3 + 0.25 * k)) for k in range(6)]
    + [Pose2(5.2 + 0.2 * k, 0.6 + 0.3 * (k % 3), 1.45 - 0.1 * (k % 4)) for k in range(6)]
)
#: What the smoothed pose of a good run is off.
ROUGH = (0.01, 0.01, 0.004)
MOVED_M = 0.10


def without(faces: list[Face], panel: str) -> list[Face]:
    return [face for face in faces if not is_panel(face, panel)]


def shifted(faces: list[Face], panel: str, by: tuple[float, float, float]) -> list[Face]:
    return [replace(face, corner=face.corner + by) if is_panel(face, panel) else face for face in faces]


def is_panel(face: Face, panel: str) -> bool:
    (x, y), _, low, _ = PANELS[panel]
    return bool(np.allclose(face.corner, [x, y, low]))


@cache
def seen_in(world: str) -> Sightings:
    """Look at a world, as it is drawn, from all the poses, each told a little wrong."""
    building = toy_building()
    faces = {
        "as mapped": building.faces,
        "no poster": without(building.faces, "poster"),
        "board moved": shifted(building.faces, "board", (MOVED_M, 0.0, 0.0)),
    }[world]
    with tempfile.TemporaryDirectory() as folder:
        wire_map = building.read(Path(folder))
    rng, config = np.random.default_rng(52), SightingConfig()
    parts = []
    for number, pose in enumerate(POSES):
        segments = extract_segments(draw(faces, CAMERA, pose, rng), CAMERA, config.lines)
        told = Pose2.from_array(pose.as_array() + rng.normal(0.0, ROUGH))
        part = sightings_of(Projector(CAMERA, wire_map), told, segments, number, config)
        assert part is not None
        parts.append(part)
    return Sightings.joined(parts)


def learnt_in(wire_map: WireMap, world: str) -> LearntMap:
    # Six looks are enough here: what is drawn is even.
    return learn(wire_map, seen_in(world), LearningConfig(polarity_share=0.8))


def suspicious(wire_map: WireMap, learnt: LearntMap, fault: Fault) -> dict[str, Array]:
    return {
        wire_map.names[found.row]: np.array(found.offset_m or np.nan)
        for found in learnt.suspicions
        if found.fault is fault
    }


@pytest.mark.parametrize(("edge", "side"), [("low", -1), ("high", 1), ("left", 1), ("right", -1)])
@pytest.mark.parametrize("panel", ["board", "poster"])
def test_the_bright_side_is_learnt(toy_map: WireMap, panel: str, edge: str, side: int) -> None:
    # Panels are darker than their wall, and run from right to left as one looks at them.
    row = toy_map.names.index(f"{panel}/{edge}")
    assert learnt_in(toy_map, "as mapped").polarity[row] == side


@pytest.mark.parametrize(
    ("brighter", "side"),
    [([1] * 8, 1), ([-1] * 8, -1), ([1] * 7, 0), ([1] * 17 + [-1], 1), ([1] * 16 + [-1], 0), ([0] * 9, 0)],
)
def test_a_side_is_told_where_nearly_all_of_many_looks_agree(
    toy_map: WireMap, brighter: list[int], side: int
) -> None:
    count = len(brighter)
    nothing = np.zeros(0, np.int64)
    looks = Sightings(
        frames=np.arange(count),
        rows=np.full(count, 3),
        lengths_px=np.full(count, 80.0),
        covered=np.abs(np.array(brighter, float)),
        brighter=np.array(brighter, float),
        line_frames=nothing,
        line_rows=nothing,
        off_px=np.zeros(0),
        sigma_px=np.zeros(0),
        pull=np.zeros((0, 3)),
        at_place=np.zeros(0, bool),
    )
    learnt = learn(toy_map, looks, LearningConfig())
    assert learnt.polarity[3] == side
    assert not learnt.polarity[np.arange(len(toy_map)) != 3].any()


def test_the_bright_side_follows_the_segment_turned_round(toy_map: WireMap) -> None:
    turned = replace(
        toy_map, endpoints=toy_map.endpoints[:, ::-1], sight_endpoints=toy_map.sight_endpoints[:, ::-1]
    )
    config, rng = SightingConfig(), np.random.default_rng(53)
    segments = extract_segments(draw(toy_building().faces, CAMERA, POSES[0], rng), CAMERA, config.lines)
    one, other = (
        sightings_of(Projector(CAMERA, of), POSES[0], segments, 0, config) for of in (toy_map, turned)
    )
    assert one is not None
    assert other is not None
    sides, opposite = (dict(zip(of.rows.tolist(), of.brighter.tolist(), strict=True)) for of in (one, other))
    assert sum(map(abs, sides.values())) > 5
    assert all(sides[row] == -opposite[row] for row in sides.keys() & opposite.keys())


def test_sharp_edges_show_and_what_is_not_there_does_not(toy_map: WireMap) -> None:
    board, poster = (
        [row for row, name in enumerate(toy_map.names) if name.startswith(panel)]
        for panel in ("board", "poster")
    )
    whole, less = learnt_in(toy_map, "as mapped"), learnt_in(toy_map, "no poster")
    assert (whole.detection_rate[board] > 0.8).all()
    assert (whole.detection_rate[poster] > 0.8).all()
    assert (less.detection_rate[board] > 0.7).all()
    assert (less.detection_rate[poster] < 0.4).all()


def test_rates_of_few_looks_keep_near_their_kind(toy_map: WireMap) -> None:
    learnt, kinds = learnt_in(toy_map, "no poster"), np.array(toy_map.kinds)
    unseen = (kinds == "panel") & (learnt.looks == 0)
    assert unseen.any()
    # All segments of a kind that nobody looked at have the kind's rate.
    assert np.ptp(learnt.detection_rate[unseen]) < 1e-12
    looked = learnt.detection_rate[(kinds == "panel") & (learnt.looks > 5)]
    assert looked.min() < learnt.detection_rate[unseen][0] < looked.max()


def test_a_true_map_raises_no_suspicion_of_its_panels(toy_map: WireMap) -> None:
    learnt = learnt_in(toy_map, "as mapped")
    assert not suspicious(toy_map, learnt, Fault.MOVED)
    assert not any("board" in name or "poster" in name for name in suspicious(toy_map, learnt, Fault.MISSING))


def test_a_panel_that_is_not_there_is_missing(toy_map: WireMap) -> None:
    learnt = learnt_in(toy_map, "no poster")
    missing = suspicious(toy_map, learnt, Fault.MISSING)
    assert {"poster/low", "poster/high", "poster/left", "poster/right"} <= missing.keys()
    assert not any("board" in name for name in missing)


def test_a_panel_hung_elsewhere_has_moved_as_far(toy_map: WireMap) -> None:
    learnt = learnt_in(toy_map, "board moved")
    moved = suspicious(toy_map, learnt, Fault.MOVED)
    assert {"board/left", "board/right"} <= moved.keys()
    for edge in ("board/left", "board/right"):
        assert np.linalg.norm(moved[edge] - [MOVED_M, 0.0, 0.0]) < 0.03
    # Along themselves its level edges moved as well, which no picture of them shows.
    assert not {"board/low", "board/high"} & moved.keys()
    assert not any(name.startswith("window") for name in moved)


def test_well_placed_edges_are_known_well_and_shaken_ones_less(toy_map: WireMap) -> None:
    rng, config = np.random.default_rng(54), SightingConfig()
    ends = toy_map.endpoints + rng.normal(0.0, 0.015, (len(toy_map), 1, 3))
    shaken = replace(toy_map, endpoints=ends, sigma_m=1.5 * toy_map.sigma_m)
    medians = []
    for wire_map in (toy_map, shaken):
        true, told = Projector(CAMERA, toy_map), Projector(CAMERA, wire_map)
        lines = [segments_at(true.predict(pose, np.arange(len(toy_map))).ideal_px) for pose in POSES]
        parts = [
            sightings_of(told, pose, line, k, config)
            for k, (pose, line) in enumerate(zip(POSES, lines, strict=True))
        ]
        learnt = learn(
            toy_map, Sightings.joined([part for part in parts if part is not None]), LearningConfig()
        )
        medians.append(float(np.nanmedian(learnt.sigma_m)))
    exact, rough = medians
    assert exact < 0.006
    assert 0.008 < rough < 0.03


def test_an_image_of_somewhere_else_tells_nothing(toy_map: WireMap) -> None:
    config = SightingConfig()
    image = draw(toy_building().faces, CAMERA, POSES[0], np.random.default_rng(55))
    segments = extract_segments(image, CAMERA, config.lines)
    there = Pose2(10.5, 1.5, math.pi)
    assert sightings_of(Projector(CAMERA, toy_map), there, segments, 0, config) is None
