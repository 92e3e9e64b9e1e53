"""Maps for other programs: plans, grids that import again, the native format."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest
from toy_building import toy_building

from maps.errors import InputError
from maps.formats.exporting import export_map
from maps.formats.imported import ImportOptions
from maps.formats.ros import import_ros
from maps.mapdocument import read_document
from maps.mapfile import build_map


@pytest.fixture
def document(tmp_path):
    toy_building().read(tmp_path)
    return read_document(tmp_path / "map.yaml")


def test_a_grid_imports_as_the_same_floor(document, tmp_path):
    said = export_map(document, tmp_path / "grid.pgm", tmp_path / "map.yaml")
    assert any("heights" in sentence for sentence in said)
    floor = build_map(import_ros(tmp_path / "grid.yaml", ImportOptions()).document, tmp_path).floor
    assert floor.symmetric_difference(build_map(document, tmp_path).floor).area < 0.02 * floor.area


def test_a_plan_is_drawn_to_scale_with_names(document, tmp_path):
    assert export_map(document, tmp_path / "plan.svg", tmp_path / "map.yaml")
    root = ET.parse(tmp_path / "plan.svg").getroot()
    titles = [title.text for title in root.iter("{http://www.w3.org/2000/svg}title")]
    assert len(titles) == len(document.segments)
    width = float(root.get("viewBox").split()[2])
    low, _, high, _ = build_map(document, tmp_path).floor.bounds
    assert width == pytest.approx(high - low + 1.0)


def test_names_are_escaped(document, tmp_path):
    segment = document.segments[0].model_copy(update={"name": "a<b>&c"})
    odd = document.model_copy(update={"segments": [segment]})
    export_map(odd, tmp_path / "plan.svg", tmp_path / "map.yaml")
    titles = [e.text for e in ET.parse(tmp_path / "plan.svg").iter() if e.tag.endswith("title")]
    assert titles == ["a<b>&c"]


def test_native_is_the_same_map(document, tmp_path):
    assert export_map(document, tmp_path / "copy.yaml", tmp_path / "map.yaml") == ()
    assert read_document(tmp_path / "copy.yaml") == document


def test_other_formats_are_refused(document, tmp_path):
    with pytest.raises(InputError, match="format not known"):
        export_map(document, tmp_path / "map.docx", tmp_path / "map.yaml")
