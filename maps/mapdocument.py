"""map.yaml as a document: what its keys mean, and writing it so that it reads back the same."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from maps.documents import checked, read_yaml

#: A building, not a planet: coordinates beyond this are in other units, or wrong.
Metres = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]
Point2 = tuple[Metres, Metres]
Point3 = tuple[Metres, Metres, Metres]
Sigma = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=10.0)]
Ring = Annotated[list[Point2], Field(min_length=3)]

DEFAULT_SIGMA_M = 0.01
#: Written coordinates are rounded to 0.1 mm: finer than any tape, and short enough to read.
DECIMALS = 4


class Segment(BaseModel):
    """One straight edge of the building; keys that are not known are kept."""

    model_config = ConfigDict(extra="allow", frozen=True)
    name: str = ""
    kind: str = "edge"
    p0: Point3
    p1: Point3
    sigma_m: Sigma | None = None
    detection_rate: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    polarity: Literal[-1, 0, 1] = 0

    @model_validator(mode="after")
    def _has_length(self) -> Segment:
        if self.p0 == self.p1:
            raise ValueError(f"segment '{self.name}' has no length")
        return self


class FloorPart(BaseModel):
    """A polygon of navigable floor with its holes; `hole_tops_m` of those that one can look over."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    outer: Ring
    holes: list[Ring] = []
    hole_tops_m: list[Metres | None] = []

    @model_validator(mode="after")
    def _tops_belong_to_holes(self) -> FloorPart:
        if self.hole_tops_m and len(self.hole_tops_m) != len(self.holes):
            raise ValueError(f"{len(self.hole_tops_m)} hole_tops_m for {len(self.holes)} holes")
        return self


class Lintel(BaseModel):
    """A vertical plane over a passage, solid from `bottom_m` up."""

    model_config = ConfigDict(extra="allow", frozen=True)
    name: str = ""
    p0: Point2
    p1: Point2
    bottom_m: Metres


class MapDocument(BaseModel):
    """The contents of map.yaml; keys that are not known are kept."""

    model_config = ConfigDict(extra="allow", frozen=True)
    units: Literal["m"] = "m"
    sigma_m: Sigma = DEFAULT_SIGMA_M
    segments: Annotated[list[Segment], Field(min_length=1)]
    floor: Annotated[list[FloorPart], Field(min_length=1)]
    lintels: list[Lintel] = []


def read_document(path: Path) -> MapDocument:
    """Read map.yaml as it stands; InputError names the key that does not fit."""
    return checked(MapDocument, read_yaml(path), path)


def write_map(path: Path, document: MapDocument) -> None:
    """Write a map that reads back the same to 0.1 mm; the file is there whole, or not at all."""
    content = {"units": document.units, **(document.model_extra or {})}
    content |= document.model_dump(exclude_defaults=True, exclude=set(content))
    text = yaml.dump(_rounded(content), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    write_whole(path, text.encode())


def write_whole(path: Path, content: bytes) -> None:
    """Write a file aside and rename it, so that nobody ever finds half of it.

    Of two processes that write the same file, the last one to be done has it. OSError, and what was there before
    stays, where it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(content)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def _rounded(value: Any) -> Any:
    match value:
        case float():
            # Adding zero turns -0.0 into 0.0.
            return round(value, DECIMALS) + 0.0
        case dict():
            return {key: _rounded(part) for key, part in value.items()}
        case list() | tuple():
            return [_rounded(part) for part in value]
    return value


_Base: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _Dumper(_Base):  # type: ignore[misc]
    """Lists of plain values, points among them, on one line; no aliases, which the reader refuses."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True

    def represent_list(self, data: list[Any]) -> yaml.Node:
        plain = not any(isinstance(part, list | dict) for part in data)
        node: yaml.Node = self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)
        return node


_Dumper.add_representer(list, _Dumper.represent_list)
