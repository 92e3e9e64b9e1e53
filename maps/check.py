"""The examination of a map: everything wrong with it, and what it amounts to in figures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from maps.documents import read_yaml
from maps.edgefaults import edge_faults
from maps.errors import InputError
from maps.findings import Finding, Severity
from maps.floorfaults import lintel_faults, reach_faults, room_faults, scale_faults, shape_faults
from maps.mapdocument import MapDocument
from maps.mapfile import build_map
from maps.regioncache import cached_regions
from maps.rooms import rooms_of
from maps.salvage import salvage
from maps.wiremap import WireMap

_ORDER = list(Severity)


@dataclass(frozen=True, slots=True)
class RegionFigures:
    """View-invariant regions: how many, seconds to build them, bytes to hold them."""

    count: int
    build_s: float
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class MapFigures:
    """What a map amounts to; `regions` None where they were not built."""

    kinds: dict[str, int]
    segments: int
    length_m: float
    floor_m2: float
    rooms: int
    regions: RegionFigures | None


@dataclass(frozen=True, slots=True)
class MapCheck:
    """All findings, the worst first; `figures` None where there is no floor to speak of."""

    findings: tuple[Finding, ...]
    figures: MapFigures | None

    def count(self, severity: Severity) -> int:
        """Return the number of findings of one severity."""
        return sum(finding.severity is severity for finding in self.findings)


def check_map(path: Path, heights_m: tuple[float, float]) -> MapCheck:
    """Examine a map file; InputError where it is no map at all.

    What the map's reader would refuse is a finding like any other, and the rest is examined without it. At
    an implausible scale nothing more is examined: every tolerance would be wrong. `heights_m`: least and
    greatest height of the camera, for the view regions, which are built only of a map without errors.
    """
    document, findings = salvage(read_yaml(path), path)
    if document is None:
        return MapCheck(tuple(findings), None)
    scale = scale_faults(document)
    findings += [*shape_faults(document), *scale]
    try:
        wire_map = build_map(document, path)
    except InputError:  # no area: the floor's shape is among the findings
        return MapCheck(_sorted(findings), None)
    if any(finding.severity is Severity.ERROR for finding in scale):
        return MapCheck(_sorted(findings), _figures(wire_map, 0, None))
    rooms = rooms_of(wire_map)
    findings += [
        *reach_faults(wire_map),
        *lintel_faults(document, wire_map),
        *edge_faults(wire_map, rooms, _open_space(document, wire_map)),
        *room_faults(wire_map, rooms),
    ]
    sound = all(finding.severity is not Severity.ERROR for finding in findings)
    regions = _region_figures(wire_map, heights_m) if sound else None
    return MapCheck(_sorted(findings), _figures(wire_map, len(rooms), regions))


def _sorted(findings: list[Finding]) -> tuple[Finding, ...]:
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.severity)))


def _open_space(document: MapDocument, wire_map: WireMap) -> BaseGeometry:
    """Return where edges can be: the floor, with the obstacles that one can look over.

    Of a part that is no polygon nobody knows what it meant to enclose; all that it may is open.
    """
    low = [
        shapely.make_valid(Polygon(hole))
        for part in document.floor
        for hole, top in zip(part.holes, part.hole_tops_m, strict=False)
        if top is not None
    ]
    outlines = [Polygon(part.outer) for part in document.floor]
    hulls = [outline.convex_hull for outline in outlines if not outline.is_valid]
    return shapely.union_all([wire_map.floor, *low, *hulls])


def _figures(wire_map: WireMap, rooms: int, regions: RegionFigures | None) -> MapFigures:
    lengths = np.linalg.norm(wire_map.endpoints[:, 1] - wire_map.endpoints[:, 0], axis=1)
    return MapFigures(
        kinds=dict(sorted(Counter(wire_map.kinds).items())),
        segments=len(wire_map),
        length_m=float(lengths.sum()),
        floor_m2=float(wire_map.floor.area),
        rooms=rooms,
        regions=regions,
    )


def _region_figures(wire_map: WireMap, heights_m: tuple[float, float]) -> RegionFigures:
    regions = cached_regions(wire_map, heights_m)
    return RegionFigures(len(regions), regions.build_seconds, regions.memory_bytes)
