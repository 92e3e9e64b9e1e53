"""Which importer reads a file: by its extension, or else by how it begins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from maps.errors import InputError
from maps.formats.apart import imported_apart
from maps.formats.dxf import import_dxf
from maps.formats.imported import Imported, ImportOptions
from maps.formats.line_list import import_lines
from maps.formats.ros import import_ros
from maps.formats.sdf import import_sdf

Importer = Callable[[Path, ImportOptions], Imported]

#: Its library is not proof against damaged files: some never end, some end the process.
import_ifc = imported_apart("maps.formats.ifc:import_ifc")

BY_EXTENSION: dict[str, Importer] = {
    ".sdf": import_sdf,
    ".world": import_sdf,
    ".dxf": import_dxf,
    ".ifc": import_ifc,
    ".yaml": import_ros,
    ".yml": import_ros,
    ".csv": import_lines,
    ".txt": import_lines,
}
#: What a file of another extension begins with.
BY_OPENING: dict[bytes, Importer] = {
    b"ISO-10303-21": import_ifc,
    b"<?xml": import_sdf,
    b"<sdf": import_sdf,
    b"image:": import_ros,
    b"0\nSECTION": import_dxf,
    b"0\r\nSECTION": import_dxf,
    b"AutoCAD Binary DXF": import_dxf,
}


def import_map(path: Path, options: ImportOptions) -> Imported:
    """Import a building from another format.

    InputError where the file is missing, of no known format, or not what its format asks for;
    MissingExtraError where its library is not installed.
    """
    if not path.is_file():
        raise InputError(path, "", "no such file")
    importer = BY_EXTENSION.get(path.suffix.lower())
    if importer is None:
        with path.open("rb") as file:
            opening = file.read(64).lstrip()
        importer = next((found for start, found in BY_OPENING.items() if opening.startswith(start)), None)
    if importer is None:
        known = ", ".join(BY_EXTENSION)
        raise InputError(path, "", f"format not known; by extension: {known}")
    return importer(path, options)
