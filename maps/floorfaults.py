"""Faults of a map's floor, lintels, units and rooms."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.validation import explain_validity

from maps.findings import Fault, Finding, Severity
from maps.lookalikes import look_alikes
from maps.mapdocument import MapDocument
from maps.poses import Array
from maps.rooms import Room, vertical
from maps.wiremap import WireMap

#: Buildings are wider and narrower than this; others are in other units.
SMALLEST_M, LARGEST_M = 1.0, 1000.0
#: Higher edges than this are rare, and a slip of units or of a digit is not.
HIGHEST_M = 20.0
#: A lintel has floor on both sides at this distance, and its ends are this near to a wall.
BESIDE_M, ENDS_M = 0.01, 0.3
#: A passage that ends lower than this lets no robot through.
LOWEST_PASSAGE_M = 0.5
#: Parts of the floor nearer than this were probably meant to touch.
SLIT_M = 0.05


def scale_faults(document: MapDocument) -> list[Finding]:
    """Return a finding where a map's extent or heights can hardly be in metres."""
    corners = np.concatenate([part.outer for part in document.floor])
    extent_m = float(np.ptp(corners, axis=0).max())
    if not SMALLEST_M <= extent_m <= LARGEST_M:
        what = f"the floor is {extent_m:g} m wide"
        advice = "give all coordinates in metres" if extent_m > 0.0 else "give its corners"
        return [Finding(Severity.ERROR, Fault.UNITS, ("floor",), what, advice)]
    heights_m = [max(segment.p0[2], segment.p1[2]) for segment in document.segments]
    tallest = int(np.argmax(heights_m))
    if heights_m[tallest] > HIGHEST_M:
        count = int(np.sum(np.array(heights_m) > HIGHEST_M))
        what = f"{heights_m[tallest]:g} m high, {count} in all above {HIGHEST_M:g} m"
        where = (document.segments[tallest].name,)
        return [Finding(Severity.WARNING, Fault.UNITS, where, what, "give all heights in metres")]
    return []


def shape_faults(document: MapDocument) -> Iterator[Finding]:
    """Yield what is wrong with the floor's polygons as they are written."""
    for row, part in enumerate(document.floor):
        polygon = Polygon(part.outer, part.holes)
        if not polygon.is_valid:
            what = re.sub(r"\[(\S+) (\S+)\]$", r" at (\1, \2)", explain_validity(polygon))
            advice = "list the corners in order along the outline, holes inside it and apart"
        elif polygon.area <= 0.0:
            what, advice = "encloses no area", "give the corners of an outline"
        else:
            continue
        yield Finding(Severity.ERROR, Fault.FLOOR_SHAPE, (f"floor[{row}]",), what, advice)


def reach_faults(wire_map: WireMap) -> Iterator[Finding]:
    """Yield the parts of the floor that are cut off from the largest one."""
    parts = sorted(wire_map.floor.geoms, key=lambda part: -float(part.area))
    for part in parts[1:]:
        place, gap_m = part.representative_point(), float(part.distance(parts[0]))
        what = f"{part.area:.2f} m2 at ({place.x:.1f}, {place.y:.1f}) are cut off, {gap_m:.3f} m away"
        advice = "let it overlap its neighbour" if gap_m < SLIT_M else "add the passage to it, or delete it"
        yield Finding(Severity.WARNING, Fault.UNREACHABLE, ("floor",), what, advice)


def lintel_faults(document: MapDocument, wire_map: WireMap) -> Iterator[Finding]:
    """Yield the lintels that close their passage, or that hang over none."""
    for row, lintel in enumerate(document.lintels):
        where = (lintel.name or f"lintels[{row}]",)
        p, q = np.array(lintel.p0), np.array(lintel.p1)
        length = float(np.linalg.norm(q - p))
        if lintel.bottom_m < LOWEST_PASSAGE_M:
            what, advice = f"its bottom is at {lintel.bottom_m:.2f} m", "correct bottom_m"
        elif length == 0.0:
            what, advice = "has no length", "give both ends of the passage"
        elif not _spans_passage(wire_map, p, q, length):
            what = "not over a passage from wall to wall"
            advice = "put it across the floor of its opening; walls need none"
        else:
            continue
        yield Finding(Severity.WARNING, Fault.LINTEL, where, what, advice)


def _spans_passage(wire_map: WireMap, p: Array, q: Array, length: float) -> bool:
    """Tell whether there is floor along both sides of a plan line, and a wall at both of its ends."""
    left = BESIDE_M / length * np.array([p[1] - q[1], q[0] - p[0]])
    sides = shapely.linestrings([[p + left, q + left], [p - left, q - left]])
    inside = shapely.length(shapely.intersection(wire_map.floor, sides))
    ends = shapely.distance(wire_map.floor.boundary, shapely.points([p, q]))
    return bool(inside.min() > 0.5 * length and ends.max() < ENDS_M)


def room_faults(wire_map: WireMap, rooms: Sequence[Room]) -> Iterator[Finding]:
    """Yield the rooms that give a camera nothing upright, and those that look like another."""
    for room in rooms:
        if not vertical(wire_map.endpoints[room.rows]).any():
            what, advice = "no upright edge", "add its corners and door frames: they fix the heading best"
            yield Finding(Severity.WARNING, Fault.NO_VERTICAL, (room.name,), what, advice)
    for alike in look_alikes(rooms, wire_map):
        a, b = alike.rooms
        itself = a is b
        what = (
            f"{'looks the same' if itself else 'look alike'}"
            f"{f' turned by {alike.turn_deg} degrees' if alike.turn_deg else ''}: "
            f"{100.0 * alike.share:.0f} % of the edges agree"
        )
        advice = "add edges that tell them apart, or give an initial pose: a lost robot may mistake them"
        where = (a.name,) if itself else (a.name, b.name)
        yield Finding(Severity.WARNING, Fault.LOOK_ALIKE, where, what, advice)
