"""Reading map.yaml: segments, floor, lintels, and what was learnt about the edges."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator
from shapely.geometry import Polygon

from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.floor import into_floor, merged_floor, walls_of
from maps.poses import frozen
from maps.wiremap import WireMap

#: A building, not a planet: coordinates beyond this are in other units, or wrong.
Metres = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]
Point2 = tuple[Metres, Metres]
Point3 = tuple[Metres, Metres, Metres]
Sigma = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=10.0)]

DEFAULT_SIGMA_M = 0.01


class _Segment(BaseModel):
    name: str = ""
    kind: str = "edge"
    p0: Point3
    p1: Point3
    sigma_m: Sigma | None = None
    detection_rate: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    polarity: Literal[-1, 0, 1] = 0

    @model_validator(mode="after")
    def _has_length(self) -> _Segment:
        if self.p0 == self.p1:
            raise ValueError(f"segment '{self.name}' has no length")
        return self


class _FloorPart(BaseModel):
    model_config = ConfigDict(extra="forbid")
    outer: Annotated[list[Point2], Field(min_length=3)]
    holes: list[Annotated[list[Point2], Field(min_length=3)]] = []
    hole_tops_m: list[Metres | None] = []

    @model_validator(mode="after")
    def _tops_belong_to_holes(self) -> _FloorPart:
        if self.hole_tops_m and len(self.hole_tops_m) != len(self.holes):
            raise ValueError(f"{len(self.hole_tops_m)} hole_tops_m for {len(self.holes)} holes")
        return self


class _Lintel(BaseModel):
    name: str = ""
    p0: Point2
    p1: Point2
    bottom_m: Metres


class _MapFile(BaseModel):
    units: Literal["m"] = "m"
    segments: Annotated[list[_Segment], Field(min_length=1)]
    floor: Annotated[list[_FloorPart], Field(min_length=1)]
    lintels: list[_Lintel] = []
    sigma_m: Sigma = DEFAULT_SIGMA_M


def read_map(path: Path) -> WireMap:
    """Read a wire map; InputError names the key that does not fit."""
    content = checked(_MapFile, read_yaml(path), path)
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
