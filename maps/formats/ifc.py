"""IFC models: the walls, doors, windows and spaces of one storey."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from maps.documents import MAX_BYTES
from maps.errors import InputError, MissingExtraError
from maps.formats.arrangement import MAX_SOLIDS, Solid, plan_of_solids
from maps.formats.assembly import map_of_plan
from maps.formats.floors import polygons_of
from maps.formats.imported import (
    GUESSED_WALL_HEIGHT_M,
    Imported,
    ImportOptions,
    Report,
    counted,
    imported,
)
from maps.poses import Array

#: Walls are cut at this height over the storey's floor, as plans are drawn: through doors and windows.
CUT_M = 1.0
#: Where the header ends at the latest, and what it must have.
_HEADER_BYTES = 2**16
_SCHEMA = re.compile(rb"FILE_SCHEMA\s*\(\s*\(\s*'\w{1,40}'\s*\)\s*\)\s*;")
#: No building is larger; beyond it areas overflow.
MAX_COORDINATE_M = 1e5
#: Rooms are lower than this; what lies higher over the floor is no ceiling of theirs.
MAX_CEILING_M = 20.0
#: What bounds a room: walls, columns, and the posts and panes of curtain walls.
WALL_CLASSES = ("IfcWall", "IfcColumn", "IfcPlate", "IfcMember")


def load() -> None:
    """Load the libraries, which takes a second or two; not having them is told when a file is read."""
    with suppress(ImportError):
        for name in (
            "ifcopenshell",
            "ifcopenshell.geom",
            "ifcopenshell.util.element",
            "ifcopenshell.util.unit",
        ):
            importlib.import_module(name)


def import_ifc(path: Path, options: ImportOptions) -> Imported:
    """Import one storey of an IFC model.

    The plan is the walls' footprints at a cut height without their openings; the openings, as voids from
    sill to head, then make doors and windows. Rooms are the model's spaces, or what the walls enclose.
    `options.storey` names the storey where there are several; otherwise the lowest one that has walls.
    MissingExtraError without ifcopenshell; InputError where the file is no IFC or has no walls.
    """
    model = _Model(path)
    storey, others = model.storey(options.storey)
    floor_m = model.elevation_m(storey)
    walls = model.in_storey(storey, WALL_CLASSES)
    solids, shapeless = _prisms(model, walls, floor_m, cut=True)
    if not solids:
        raise InputError(path, str(storey.Name), "no wall with a shape in this storey")
    fillings, voids = _openings(model, walls, solids, floor_m)
    if len(solids) + len(fillings) + len(voids) > MAX_SOLIDS:
        raise InputError(path, str(storey.Name), f"more than {MAX_SOLIDS} walls and openings")
    spaces = _spaces(model, storey)
    height_m, source = _room_height(model, storey, options.wall_height_m)
    plan, planned = plan_of_solids([*solids, *fillings, *voids], height_m, spaces)
    content, mapped = map_of_plan(plan)
    found: dict[str, int | float] = {
        f"{kind.removeprefix('Ifc').lower()}s": len(model.in_storey(storey, (kind,)))
        for kind in ("IfcWall", "IfcDoor", "IfcWindow", "IfcCurtainWall")
    }
    found |= {"spaces": len(spaces), "wall_height_m": round(height_m, 4)}
    dropped = tuple(f"storey {name}" for name in others)
    if shapeless:
        dropped += (f"{counted(shapeless, 'element')} without a shape at the cut {CUT_M} m over the floor",)
    report = Report(found, dropped, (source,) if source else ())
    return imported(content, report + planned + mapped, path)


class _Model:
    """An open IFC file, its lengths turned into metres."""

    def __init__(self, path: Path) -> None:
        try:
            self._ifc = importlib.import_module("ifcopenshell")
            self._geometry = importlib.import_module("ifcopenshell.geom")
            self._element = importlib.import_module("ifcopenshell.util.element")
            units = importlib.import_module("ifcopenshell.util.unit")
        except ImportError:
            raise MissingExtraError("IFC needs ifcopenshell: pip install 'wireloc[maps]'") from None
        self.path = path
        self._file = self._opened(path)
        try:
            self._unit_m = float(units.calculate_unit_scale(self._file))
        except (AttributeError, KeyError, TypeError, ValueError):
            raise InputError(path, "IfcUnitAssignment", "the unit of lengths is not as IFC has it") from None
        self._settings = self._geometry.settings()
        self._settings.set("use-world-coords", True)
        self._settings.set("disable-opening-subtractions", True)

    def _opened(self, path: Path) -> Any:
        try:
            if path.stat().st_size > MAX_BYTES:
                raise InputError(path, "", f"larger than {MAX_BYTES // 2**20} MB")
            with path.open("rb") as file:
                header = file.read(_HEADER_BYTES)
            if not header[:64].lstrip().startswith(b"ISO-10303-21"):
                raise InputError(path, "line 1", "not an IFC file: no ISO-10303-21")
            # At some headers without it the library does not raise but ends the process.
            if not _SCHEMA.search(header):
                raise InputError(path, "FILE_SCHEMA", "missing in the header, or not a schema's name")
            return self._ifc.open(str(path))
        except OSError as error:
            raise InputError(path, "", error.strerror or str(error)) from None
        except (RuntimeError, ValueError, self._ifc.Error) as error:
            raise InputError(path, "", f"not an IFC file: {error}") from None

    def storey(self, name: str | None) -> tuple[Any, list[str]]:
        """Return the storey of that name, or the lowest one with walls, and the names of the others."""
        storeys = sorted(self._file.by_type("IfcBuildingStorey"), key=self.elevation_m)
        known = [str(storey.Name) for storey in storeys]
        if name is None:
            fitting = [storey for storey in storeys if self.in_storey(storey, ("IfcWall",))]
        else:
            fitting = [storey for storey in storeys if storey.Name == name]
        if not fitting:
            what = "no storey has walls" if name is None else f"no storey '{name}' among {', '.join(known)}"
            raise InputError(self.path, "", what)
        return fitting[0], [str(storey.Name) for storey in storeys if storey is not fitting[0]]

    def elevation_m(self, storey: Any) -> float:
        """Return a storey's elevation."""
        try:
            return float(storey.Elevation or 0.0) * self._unit_m
        except (TypeError, ValueError):
            raise InputError(self.path, str(storey.Name), "its Elevation is not a number") from None

    def next_elevation_m(self, storey: Any) -> float | None:
        """Return the elevation of the storey above."""
        here = self.elevation_m(storey)
        above = [self.elevation_m(other) for other in self._file.by_type("IfcBuildingStorey")]
        return min((z for z in above if z > here + CUT_M), default=None)

    def in_storey(self, storey: Any, kinds: Sequence[str]) -> list[Any]:
        """Return the elements of some classes in a storey, also as parts of others there."""
        elements = [element for kind in kinds for element in self._file.by_type(kind)]
        return [element for element in elements if self._home(element) == storey]

    def of_kind(self, kind: str) -> list[Any]:
        """Return all elements of a class."""
        return list(self._file.by_type(kind))

    def openings(self, wall: Any) -> list[Any]:
        """Return the openings of a wall, called as the door or window that fills them."""
        relations = getattr(wall, "HasOpenings", ())
        openings = [getattr(relation, "RelatedOpeningElement", None) for relation in relations]
        return [opening for opening in openings if opening is not None]

    def name(self, element: Any) -> str:
        """Return what an element is called; an opening as what fills it."""
        fillings = getattr(element, "HasFillings", ())
        called = getattr(fillings[0], "RelatedBuildingElement", None) if fillings else None
        called = called or element
        return str(called.Name or called.is_a().removeprefix("Ifc").lower())

    def mesh(self, element: Any) -> tuple[Array, Any] | None:
        """Return an element's vertices (V, 3) [m], map frame, and triangles (T, 3), or None."""
        try:
            shape = self._geometry.create_shape(self._settings, element)
        except (RuntimeError, TypeError, ValueError):
            # The library gave up on it, or a reference of it leads nowhere.
            return None
        vertices = np.array(shape.geometry.verts).reshape(-1, 3)
        triangles = np.array(shape.geometry.faces, np.int64).reshape(-1, 3)
        if not len(triangles) or not (np.abs(vertices) < MAX_COORDINATE_M).all():
            return None
        return vertices, triangles

    def _home(self, element: Any) -> Any:
        whole = self._element.get_aggregate(element)
        return self._element.get_container(element) or whole


def _prisms(model: _Model, elements: Sequence[Any], floor_m: float, *, cut: bool) -> tuple[list[Solid], int]:
    """Return the elements as prisms over the storey's floor, and how many have no shape there.

    `cut`: their outline is that at the cut height; otherwise that of their whole shadow on the floor.
    """
    solids: list[Solid] = []
    without = 0
    for element in elements:
        mesh = model.mesh(element)
        outlines = [] if mesh is None else list(_section(*mesh, floor_m + CUT_M) if cut else _shadow(*mesh))
        if mesh is None or not outlines:
            without += 1
            continue
        low, high = float(mesh[0][:, 2].min() - floor_m), float(mesh[0][:, 2].max() - floor_m)
        solids += [Solid(model.name(element), outline, low, high) for outline in outlines]
    return solids, without


def _openings(
    model: _Model, walls: Sequence[Any], solids: Sequence[Solid], floor_m: float
) -> tuple[list[Solid], list[Solid]]:
    """Return the openings of walls as voids, and what fills walls that come with them already cut."""
    fillings: list[Solid] = []
    voids: list[Solid] = []
    for wall in walls:
        pieces = [solid for solid in solids if solid.name == model.name(wall)]
        holes, _ = _prisms(model, model.openings(wall), floor_m, cut=False)
        if pieces and holes:
            # Openings are often cut out of more than the wall.
            whole = shapely.unary_union([piece.outline for piece in pieces]).convex_hull
            high = max(piece.top_m for piece in pieces)
            fillings += [
                Solid(hole.name, outline, 0.0, high)
                for hole in holes
                for outline in polygons_of(hole.outline.intersection(whole))
            ]
        voids += [replace(hole, void=True) for hole in holes]
    return fillings, voids


def _section(vertices: Array, triangles: Any, z: float) -> Iterator[Polygon]:
    """Yield the outlines of what a level plane cuts out of a closed mesh."""
    corners = vertices[triangles]
    above = corners[:, :, 2] > z
    crossed = corners[above.any(axis=1) & ~above.all(axis=1)]
    segments = []
    for triangle in crossed:
        points = [
            a + (z - a[2]) / (b[2] - a[2]) * (b - a)
            for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
            if (a[2] > z) != (b[2] > z)
        ]
        segments.append([point[:2] for point in points])
    linework = (
        shapely.unary_union(shapely.linestrings(np.array(segments)), grid_size=1e-4) if segments else None
    )
    if linework is not None:
        yield from (face for face in shapely.get_parts(shapely.polygonize([linework])) if face.area > 1e-5)


def _shadow(vertices: Array, triangles: Any) -> Iterator[Polygon]:
    """Yield the outlines of a mesh seen from above."""
    flat = shapely.polygons(vertices[triangles][:, :, :2])
    union = shapely.unary_union(flat[shapely.area(flat) > 1e-8], grid_size=1e-4)
    yield from polygons_of(union)


def _spaces(model: _Model, storey: Any) -> list[tuple[Polygon, str]]:
    """Return the outlines and names of a storey's spaces."""
    spaces = []
    for space in model.in_storey(storey, ("IfcSpace",)):
        mesh = model.mesh(space)
        name = str(space.LongName or space.Name or "room")
        spaces += [(outline, name) for outline in _shadow(*mesh)] if mesh else []
    return spaces


def _room_height(model: _Model, storey: Any, told_m: float | None) -> tuple[float, str]:
    """Return the rooms' height, and a sentence where it had to be guessed."""
    floor_m = model.elevation_m(storey)
    if told_m is not None:
        return told_m, ""
    ceilings = [e for e in model.in_storey(storey, ("IfcCovering",)) if e.PredefinedType == "CEILING"]
    for elements, what in ((ceilings, "ceilings"), (model.of_kind("IfcSlab"), "the slab above")):
        meshes = [mesh for element in elements if (mesh := model.mesh(element))]
        lows = [float(vertices[:, 2].min()) - floor_m for vertices, _ in meshes]
        within = [low for low in lows if 2.0 * CUT_M < low < MAX_CEILING_M]
        if within:
            return min(within), f"the wall height, {min(within):.3f} m, is that of {what}"
    above_m = model.next_elevation_m(storey)
    if above_m is not None:
        return above_m - floor_m, f"the wall height, {above_m - floor_m:.3f} m, is that of the next storey"
    return GUESSED_WALL_HEIGHT_M, f"the wall height, {GUESSED_WALL_HEIGHT_M} m: the file tells none"
