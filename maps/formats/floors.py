"""Floors on their way into a map: the largest connected one, as polygons with holes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import LinearRing

from maps.floor import merged_floor
from maps.formats.imported import Report, counted

#: A smaller hole in the floor is no obstacle.
MIN_HOLE_M2 = 0.01
#: Holes of a floor must not touch its outline, nor each other: a low wall ends this short of a high one.
SLIT_M = 1e-3


def polygons_of(shape: BaseGeometry) -> list[Polygon]:
    """Return the polygons among a shape's parts."""
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]


def floor_entries(floor: MultiPolygon, low: Sequence[tuple[Polygon, float]] = ()) -> list[dict[str, Any]]:
    """Return the floor as map.yaml writes it, with holes for low obstacles (outline, top [m]) in it."""
    entries = []
    for part in merged_floor([*floor.geoms, *(polygon for polygon, _ in low)]).geoms:
        holes = [_ring(ring) for ring in part.interiors]
        tops: list[float | None] = [None] * len(holes)
        taken: BaseGeometry = part.boundary.buffer(SLIT_M, join_style="mitre")
        for outline, top_m in low:
            for hole in polygons_of(outline.intersection(part).difference(taken)):
                holes.append(_ring(hole.exterior))
                tops.append(top_m)
            taken = taken.union(outline.buffer(SLIT_M, join_style="mitre"))
        entry: dict[str, Any] = {"outer": _ring(part.exterior)}
        if holes:
            entry["holes"] = holes
        if any(top is not None for top in tops):
            entry["hole_tops_m"] = tops
        entries.append(entry)
    return entries


def largest_floor(floor: MultiPolygon) -> tuple[MultiPolygon, Report]:
    """Return the largest connected part, without pinholes, and what was left out."""
    parts = sorted(floor.geoms, key=lambda part: part.area, reverse=True)
    if not parts:
        return floor, Report()
    holes = [ring for ring in parts[0].interiors if Polygon(ring).area >= MIN_HOLE_M2]
    dropped = []
    if len(parts) > 1:
        area = sum(part.area for part in parts[1:])
        what = counted(len(parts) - 1, "floor part")
        dropped.append(
            f"{what} that cannot be reached from the largest one ({area:.1f} of {floor.area:.1f} m2)"
        )
    pinholes = len(parts[0].interiors) - len(holes)
    if pinholes:
        dropped.append(f"{counted(pinholes, 'hole')} in the floor smaller than {MIN_HOLE_M2} m2")
    return MultiPolygon([Polygon(parts[0].exterior, holes)]), Report({}, tuple(dropped))


def _ring(ring: LinearRing) -> list[tuple[float, float]]:
    return [(x, y) for x, y in np.asarray(ring.coords)[:-1, :2].tolist()]
