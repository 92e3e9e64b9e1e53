"""IFC models, made here: a storey in millimetres with walls, a door and a window."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from maps.errors import InputError, MissingExtraError
from maps.formats.ifc import import_ifc
from maps.formats.imported import ImportOptions
from maps.mapfile import build_map

ifcopenshell = pytest.importorskip("ifcopenshell")


class House:
    """Two rooms of 4 x 3 m, 2.6 m high, on a storey that lies 500 mm up; IFC4, millimetres."""

    def __init__(self) -> None:
        self.file = file = ifcopenshell.file(schema="IFC4")
        self.count = 0
        unit = file.createIfcSIUnit(UnitType="LENGTHUNIT", Prefix="MILLI", Name="METRE")
        self.context = file.createIfcGeometricRepresentationContext(
            None, "Model", 3, 1e-5, self.placement(0, 0, 0), None
        )
        project = file.createIfcProject(self.id(), None, "p")
        project.RepresentationContexts = [self.context]
        project.UnitsInContext = file.createIfcUnitAssignment([unit])
        self.storey = file.createIfcBuildingStorey(self.id(), None, "Ground", Elevation=500.0)
        upper = file.createIfcBuildingStorey(self.id(), None, "Upper", Elevation=3100.0)
        file.createIfcRelAggregates(self.id(), None, None, None, project, [self.storey, upper])
        walls = [
            self.wall("south", -200, -200, 8600, 200),
            self.wall("north", -200, 3000, 8600, 200),
            self.wall("west", -200, 0, 200, 3000),
            self.wall("east", 8200, 0, 200, 3000),
            self.wall("middle", 4000, 0, 200, 3000),
        ]
        door = self.opening(walls[4], 3900, 1000, 400, 900, 0, 2000, "IfcDoor", "door 7")
        window = self.opening(walls[0], 1000, -300, 1200, 400, 900, 1200, "IfcWindow", "window 3")
        contained = [*walls, door, window]
        file.createIfcRelContainedInSpatialStructure(self.id(), None, None, None, contained, self.storey)

    def id(self) -> str:
        self.count += 1
        return f"{self.count:022d}"

    def placement(self, x: float, y: float, z: float) -> object:
        point = self.file.createIfcCartesianPoint((float(x), float(y), float(z)))
        return self.file.createIfcAxis2Placement3D(point)

    def body(
        self, kind: str, name: str, x: float, y: float, wide: float, deep: float, z: float, high: float
    ) -> object:
        file = self.file
        centre = file.createIfcAxis2Placement2D(file.createIfcCartesianPoint((wide / 2.0, deep / 2.0)))
        profile = file.createIfcRectangleProfileDef("AREA", None, centre, float(wide), float(deep))
        up = file.createIfcDirection((0.0, 0.0, 1.0))
        solid = file.createIfcExtrudedAreaSolid(profile, self.placement(0, 0, 0), up, float(high))
        shape = file.createIfcShapeRepresentation(self.context, "Body", "SweptSolid", [solid])
        return file.create_entity(
            kind,
            GlobalId=self.id(),
            Name=name,
            ObjectPlacement=file.createIfcLocalPlacement(None, self.placement(x, y, z + 500.0)),
            Representation=file.createIfcProductDefinitionShape(None, None, [shape]),
        )

    def wall(self, name: str, x: float, y: float, wide: float, deep: float) -> object:
        return self.body("IfcWall", name, x, y, wide, deep, 0, 2600)

    def opening(
        self,
        wall: object,
        x: float,
        y: float,
        wide: float,
        deep: float,
        z: float,
        high: float,
        kind: str,
        name: str,
    ) -> object:
        void = self.body("IfcOpeningElement", "void", x, y, wide, deep, z, high)
        self.file.createIfcRelVoidsElement(self.id(), None, None, None, wall, void)
        filling = self.file.create_entity(kind, GlobalId=self.id(), Name=name)
        self.file.createIfcRelFillsElement(self.id(), None, None, None, void, filling)
        return filling


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    path = tmp_path_factory.mktemp("ifc") / "house.ifc"
    House().file.write(str(path))
    return path


def test_two_rooms_with_a_door_and_a_window(house):
    result = import_ifc(house, ImportOptions())
    wire_map = build_map(result.document, house)
    assert wire_map.floor.area == pytest.approx(2 * 12.0 + 0.18, abs=0.01)
    found = result.report.found
    assert (found["walls"], found["doors"], found["windows"]) == (5, 1, 1)
    assert (found["rooms"], found["passages"], found["window_openings"]) == (2, 1, 1)
    assert found["wall_height_m"] == pytest.approx(2.6)
    assert {lintel.bottom_m for lintel in result.document.lintels} == {2.0}
    window = [s for s in result.document.segments if "window 3" in s.name]
    ends = np.array([[s.p0, s.p1] for s in window])
    np.testing.assert_allclose(ends.min(axis=(0, 1)), [1.0, 0.0, 0.9], atol=1e-3)
    np.testing.assert_allclose(ends.max(axis=(0, 1)), [2.2, 0.0, 2.1], atol=1e-3)
    assert any("door 7" in s.name for s in result.document.segments)
    assert any("next storey" in sentence for sentence in result.report.guessed)
    assert "storey Upper" in result.report.dropped


def test_a_storey_is_named(house):
    assert (
        import_ifc(house, ImportOptions(storey="Ground")).document
        == import_ifc(house, ImportOptions()).document
    )
    with pytest.raises(InputError, match="no storey 'Attic' among Ground, Upper"):
        import_ifc(house, ImportOptions(storey="Attic"))
    with pytest.raises(InputError, match="no wall"):
        import_ifc(house, ImportOptions(storey="Upper"))


def test_missing_library_is_told_with_the_command_that_installs_it(house, monkeypatch):
    monkeypatch.setitem(sys.modules, "ifcopenshell", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'wireloc\[maps\]'"):
        import_ifc(house, ImportOptions())


@pytest.mark.parametrize(
    "content", [b"", b"poem", b"ISO-10303-21;\nHEADER;\n", b"ISO-10303-21;\nDATA;\n#1=IFCWALL(;\n"]
)
def test_nonsense_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "a.ifc"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        import_ifc(path, ImportOptions())
    assert str(caught.value).startswith(str(path))
