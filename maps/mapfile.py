"""The wire map that a map.yaml describes: its arrays, its walls, its lines of sight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from maps.errors import InputError
from maps.floor import into_floor, merged_floor, walls_of
from maps.mapdocument import MapDocument, read_document
from maps.poses import frozen
from maps.wiremap import WireMap


def read_map(path: Path) -> WireMap:
    """Read a wire map; InputError names the key that does not fit."""
    return build_map(read_document(path), path)


def build_map(content: MapDocument, path: Path) -> WireMap:
    """Return the wire map of a document; InputError, naming `path`, where its floor encloses nothing."""
    floor = merged_floor([Polygon(part.outer, part.holes) for part in content.floor])
    if floor.is_empty:
        raise InputError(path, "floor", "the polygons enclose no area")
    low_obstacles = [
        (Polygon(hole), top)
        for part in content.floor
        for hole, top in zip(part.holes, part.hole_tops_m, strict=False)
        if top is not None
    ]
    walls, tops = walls_of(floor, low_obstacles)
    segments = content.segments
    endpoints = np.array([[segment.p0, segment.p1] for segment in segments])
    sight = endpoints.copy()
    sight[:, :, :2] = into_floor(floor, endpoints[:, :, :2].reshape(-1, 2)).reshape(-1, 2, 2)
    rates = [np.nan if s.detection_rate is None else s.detection_rate for s in segments]
    return WireMap(
        endpoints=frozen(endpoints),
        names=tuple(s.name or f"segments[{row}]" for row, s in enumerate(segments)),
        kinds=tuple(segment.kind for segment in segments),
        sigma_m=frozen(np.array([segment.sigma_m or content.sigma_m for segment in segments])),
        detection_rate=frozen(np.array(rates)),
        polarity=frozen(np.array([segment.polarity for segment in segments])),
        floor=floor,
        sight_endpoints=frozen(sight),
        walls=frozen(walls),
        wall_tops_m=frozen(tops),
        lintels=frozen(np.array([[lintel.p0, lintel.p1] for lintel in content.lintels]).reshape(-1, 2, 2)),
        lintel_bottoms_m=frozen(np.array([lintel.bottom_m for lintel in content.lintels])),
    )
