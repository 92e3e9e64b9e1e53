"""What an import is told, and what it gives back: a map and an account of how it was come by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from maps.documents import checked
from maps.mapdocument import MapDocument

#: Of rooms where nobody says: what most dwellings and offices have.
GUESSED_WALL_HEIGHT_M = 2.5
#: How well a guessed height is known; it goes into the edges that depend on it.
GUESSED_SIGMA_M = 0.1


class LayerKind(StrEnum):
    """What the lines of a drawing's layer stand for."""

    WALL = "wall"
    DOOR = "door"
    WINDOW = "window"
    IGNORE = "ignore"


@dataclass(frozen=True, slots=True)
class LayerRule:
    """What a layer holds, and from where to where it reaches [m]; None: not told."""

    kind: LayerKind
    bottom_m: float | None = None
    top_m: float | None = None


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a person knows and the file does not say; None: not told."""

    wall_height_m: float | None = None
    layers: Mapping[str, LayerRule] = field(default_factory=dict)
    storey: str | None = None
    unit_m: float | None = None


@dataclass(frozen=True, slots=True)
class Report:
    """What was found (counts), what of it was left out, and what had to be guessed (sentences)."""

    found: Mapping[str, int | float] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    guessed: tuple[str, ...] = ()

    def __add__(self, other: Report) -> Report:
        return Report(
            {**self.found, **other.found}, self.dropped + other.dropped, self.guessed + other.guessed
        )


@dataclass(frozen=True, slots=True)
class Imported:
    """A map from another format, and how it was come by."""

    document: MapDocument
    report: Report


def imported(content: dict[str, Any], report: Report, path: Path) -> Imported:
    """Check a map's content and add its counts; InputError, naming `path`, where it is no map."""
    document = checked(MapDocument, content, path)
    counts = {
        "segments": len(document.segments),
        "lintels": len(document.lintels),
        "floor_parts": len(document.floor),
        "floor_holes": sum(len(part.holes) for part in document.floor),
    }
    return Imported(document, report + Report(counts))


def counted(number: int, thing: str) -> str:
    """Return `1 wall`, `2 walls`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
