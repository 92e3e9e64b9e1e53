"""Buildings of other people: what an importer should find in them; needs the development data."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from maps.formats.imported import ImportOptions
from maps.formats.importing import import_map
from maps.mapfile import build_map


@pytest.fixture(scope="module")
def samples(data):
    return data / "map_samples"


@pytest.fixture(scope="module")
def expected(samples):
    return yaml.safe_load((samples / "expected.yaml").read_text())


def bounds(result):
    ends = np.array([[segment.p0, segment.p1] for segment in result.document.segments])
    return ends.min(axis=(0, 1)), ends.max(axis=(0, 1))


def test_building_a(samples, expected, data):
    want = expected["building_a.dxf"]
    result = import_map(samples / "building_a.dxf", ImportOptions())
    found = result.report.found
    assert found["closed_wall_lines"] == want["wall_polylines"]
    assert found["wall_total_length_m"] == pytest.approx(want["wall_total_length_m"], abs=1e-3)
    assert (found["door_lines"], found["doors"], found["windows"]) == (12, want["doors"], want["windows"])
    assert found["passages"] == 5
    assert bounds(result)[1][2] == want["highest_corner_m"]
    floor = build_map(result.document, samples).floor
    assert floor.area == pytest.approx(want["floor_area_m2"], abs=1e-3)
    measured = build_map(import_native(data / "rendered" / "building_a" / "map.yaml"), samples)
    assert floor.symmetric_difference(measured.floor).area < 0.05


def import_native(path):
    from maps.mapdocument import read_document

    return read_document(path)


def test_turtlebot3_house(samples, expected):
    want = expected["turtlebot3_house.sdf"]
    result = import_map(samples / "turtlebot3_house.sdf", ImportOptions())
    found = result.report.found
    assert found["wall_links"] == want["wall_links"]
    assert found["boxes"] == want["collision_boxes"]
    assert found["boxes_from_floor_up"] == want["boxes_from_floor_up"]
    low, high = bounds(result)
    # The edges are those of the inner faces: 15 cm inside of the outer ones.
    np.testing.assert_allclose(low, np.add(want["box_min_m"], [0.15, 0.15, 0.0]), atol=0.01)
    np.testing.assert_allclose(high, np.subtract(want["box_max_m"], [0.15, 0.15, 0.0]), atol=0.01)
    assert len(build_map(result.document, samples).floor.geoms) == 1
    assert (found["rooms"], found["passages"]) == (6, 5)


def test_sample_house(samples, expected):
    pytest.importorskip("ifcopenshell")
    want = expected["sample_house.ifc"]
    result = import_map(samples / "sample_house.ifc", ImportOptions())
    found = result.report.found
    assert (found["walls"], found["doors"], found["windows"]) == (
        want["walls"],
        want["doors"],
        want["windows"],
    )
    low, high = bounds(result)
    assert (low >= np.array(want["walls_box_min_m"]) - 1e-3).all()
    assert (high <= np.array(want["walls_box_max_m"]) + 1e-3).all()
    wire_map = build_map(result.document, samples)
    assert len(wire_map.floor.geoms) == 1
    # The living room's inner north and east faces, as the walls' boxes have them.
    boxes = {wall["name"].rsplit(":", 1)[1]: wall for wall in want["wall_boxes_m"]}
    faces = {round(s.p0[1], 3) for s in result.document.segments if s.kind == "floor" and s.p0[1] == s.p1[1]}
    assert round(boxes["285330"]["min"][1], 3) in faces
    faces = {round(s.p0[0], 3) for s in result.document.segments if s.kind == "floor" and s.p0[0] == s.p1[0]}
    assert {round(boxes["285792"]["min"][0], 3), round(boxes["285395"]["min"][0], 3)} <= faces


def test_lab(samples, expected):
    want = expected["lab.yaml"]
    result = import_map(samples / "lab.yaml", ImportOptions())
    found = result.report.found
    assert (found["width"], found["height"]) == (want["width"], want["height"])
    assert found["occupied_cells"] == want["occupied_cells"]
    assert found["free_cells"] == want["free_cells"]
    wire_map = build_map(result.document, samples)
    assert len(wire_map.floor.geoms) == 1
    assert len(wire_map.floor.geoms[0].interiors) == 5
    (low_x, low_y), (high_x, high_y) = want["occupied_cell_centres_box_m"]
    inside = wire_map.floor.bounds
    assert low_x < inside[0] < inside[2] < high_x
    assert low_y < inside[1] < inside[3] < high_y + 0.05
    sides = [s for s in result.document.segments if s.kind == "floor"]
    assert len(sides) < 50
