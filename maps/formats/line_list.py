"""Plain lists of lines in space: six numbers a line of text."""

from __future__ import annotations

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from maps.documents import read_text
from maps.errors import InputError
from maps.floor import merged_floor
from maps.formats.arrangement import GRID_M
from maps.formats.floors import floor_entries, largest_floor, polygons_of
from maps.formats.imported import Imported, ImportOptions, Report, counted, imported
from maps.formats.wirelines import WireLine, tidy

MAX_LINES = 100_000
#: In any unit: no building is larger, and squares of it stay finite.
MAX_COORDINATE = 1e12
#: Lines within this of the lowest point lie on the floor.
ON_FLOOR_M = 0.05
#: Closed loops of floor lines enclose at least this share of what the lines span; less is a table.
MIN_LOOP_SHARE = 0.2
_BETWEEN = re.compile(r"[,;\s]+")
_UPRIGHT, _LEVEL = math.cos(math.radians(3.0)), math.sin(math.radians(3.0))


def import_lines(path: Path, options: ImportOptions) -> Imported:
    """Import lines `x0 y0 z0 x1 y1 z1 [name]`, separated by commas, semicolons or blanks.

    `#` begins a comment; a first line of words is a header. The floor is what the lowest lines enclose, or
    a guess. `options.unit_m`: what one unit of the file is. InputError names the line that does not fit.
    """
    ends, names = _read(path)
    ends = ends * (options.unit_m or 1.0)
    lines = [
        _line(pair.tolist(), name, number)
        for number, (pair, name) in enumerate(zip(ends, names, strict=True), 1)
    ]
    whole = tidy(lines)
    if not whole:
        raise InputError(path, "", "no line with a length")
    floor, guessed = _floor(np.array([[line.p0, line.p1] for line in whole]))
    if floor.is_empty:
        raise InputError(path, "", "the lines span no floor: they lie on one another in plan")
    kept, report = largest_floor(floor)
    found: dict[str, int | float] = {"lines": len(lines), "floor_area_m2": round(kept.area, 3)}
    found |= Counter(f"{line.kind}_lines" for line in whole)
    dropped = (f"{counted(len(lines) - len(whole), 'line')} drawn twice, joined or under 5 cm",)
    content = {"segments": [line.entry() for line in whole], "floor": floor_entries(kept)}
    return imported(
        content, Report(found, dropped if len(lines) > len(whole) else (), guessed) + report, path
    )


def _read(path: Path) -> tuple[np.ndarray[tuple[int, int, int], np.dtype[np.float64]], list[str]]:
    rows: list[list[float]] = []
    names: list[str] = []
    for number, text in enumerate(read_text(path).splitlines(), start=1):
        words = [word for word in _BETWEEN.split(text.split("#", 1)[0].strip(), maxsplit=6) if word]
        if not words or (not rows and not names and _is_header(words)):
            continue
        try:
            values = [float(word) for word in words[:6]]
        except ValueError:
            values = []
        if len(values) != 6 or not all(abs(value) < MAX_COORDINATE for value in values):
            raise InputError(path, f"line {number}", "expected six numbers: x0 y0 z0 x1 y1 z1")
        if len(rows) == MAX_LINES:
            raise InputError(path, f"line {number}", f"more than {MAX_LINES} lines")
        rows.append(values)
        names.append(words[6].strip(" \"'") if len(words) > 6 else "")
    if not rows:
        raise InputError(path, "", "no lines")
    return np.array(rows).reshape(-1, 2, 3), names


def _is_header(words: list[str]) -> bool:
    return len(words) >= 6 and all(re.match(r"[A-Za-z_]", word) for word in words[:6])


def _line(ends: list[list[float]], name: str, number: int) -> WireLine:
    (x0, y0, z0), (x1, y1, z1) = ends
    length = math.dist(ends[0], ends[1])
    rise = abs(z1 - z0) / length if length else 0.0
    kind = "vertical" if rise > _UPRIGHT else "horizontal" if rise < _LEVEL else "slanted"
    return WireLine(name or f"{kind}{number}", kind, (x0, y0, z0), (x1, y1, z1))


def _floor(
    ends: np.ndarray[tuple[int, int, int], np.dtype[np.float64]],
) -> tuple[MultiPolygon, tuple[str, ...]]:
    """Return the floor that lines (N, 2, 3) outline, and how that was guessed."""
    low = ends[:, :, 2].max(axis=1) < ends[:, :, 2].min() + ON_FLOOR_M
    hull = shapely.MultiPoint(ends[:, :, :2].reshape(-1, 2)).convex_hull
    if low.any():
        network = shapely.unary_union(shapely.linestrings(ends[low][:, :, :2]), grid_size=GRID_M)
        faces = polygons_of(shapely.polygonize([network]))
        # What fills a hole of a larger loop is a pillar or a box, not floor.
        holes = merged_floor([Polygon(ring) for face in faces for ring in face.interiors])
        floor = merged_floor([face for face in faces if not holes.contains(face.representative_point())])
        if floor.area > MIN_LOOP_SHARE * hull.area:
            return floor, ("the floor is what the lowest lines enclose",)
    if not isinstance(hull, Polygon):
        return MultiPolygon(), ()
    rectangle = hull.minimum_rotated_rectangle
    square = hull.area > 0.9 * rectangle.area
    outline, shape = (rectangle, "rectangle") if square else (hull, "hull")
    guess = f"the lowest lines enclose no floor: it is the {shape} around all lines"
    return MultiPolygon(polygons_of(outline)), (guess,)
