"""CAD drawings (DXF): lines and polylines on layers, a plan without heights."""

from __future__ import annotations

import importlib
import logging
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maps.documents import MAX_BYTES
from maps.errors import InputError, MissingExtraError
from maps.formats.assembly import map_of_plan
from maps.formats.drawing import Drawing, plan_of_drawing
from maps.formats.imported import (
    GUESSED_WALL_HEIGHT_M,
    Imported,
    ImportOptions,
    LayerKind,
    LayerRule,
    Report,
    imported,
)
from maps.poses import Array

#: Words in the names of layers, in a few languages of the trade.
LAYER_WORDS = {
    LayerKind.DOOR: ("DOOR", "TUER", "TÜR", "PORTE", "PUERTA"),
    LayerKind.WINDOW: ("WINDOW", "GLAZ", "FENSTER", "FENETRE", "VENTANA"),
    LayerKind.WALL: ("WALL", "WAND", "MUR"),
}
#: $INSUNITS: what one unit of the drawing is in metres.
UNITS_M = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 14: 0.1}
#: A building wider than this in metres is drawn in millimetres.
MAX_METRES = 500.0
MAX_ENTITIES = 200_000
#: Coordinates beyond this, in any unit, are no building's.
MAX_COORDINATE = 1e9
NONSENSE = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    ArithmeticError,
    StopIteration,
    RecursionError,
)
_CEILING = re.compile(r"\b(?:CEILING|CLG|DECKE)\D{0,4}(\d+(?:[.,]\d+)?)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _Contents:
    """What a drawing holds, in its own units: polylines (N, 2) by kind, heights in texts, the rest."""

    lines: Mapping[LayerKind, tuple[Array, ...]]
    ceilings: tuple[float, ...]
    dropped: Counter[str]


def import_dxf(path: Path, options: ImportOptions) -> Imported:
    """Import the walls, doors and windows of a drawing.

    What a layer holds is told by `options.layers` or by its name. Lengths are in $INSUNITS, heights come
    from the options, from a text like `CEILING 3200`, or are guessed. MissingExtraError without ezdxf.
    """
    document, contents = _read(path, options.layers)
    unit_m, guesses = _unit(document, contents, options.unit_m)
    walls = {kind: tuple(unit_m * line for line in lines) for kind, lines in contents.lines.items()}
    height_m, told, height_guess = _height(contents.ceilings, unit_m, options.wall_height_m)
    rules = {rule.kind: rule for rule in options.layers.values() if rule.top_m is not None}
    drawing = Drawing(walls[LayerKind.WALL], walls[LayerKind.DOOR], walls[LayerKind.WINDOW])
    plan, planned = plan_of_drawing(drawing, height_m, told, rules, path)
    content, mapped = map_of_plan(plan)
    counts: dict[str, int | float] = {
        f"{kind}_lines": len(walls[kind]) for kind in walls if kind != LayerKind.IGNORE
    }
    counts |= {"wall_height_m": round(height_m, 4), "unit_m": unit_m}
    dropped = tuple(f"{what}: {number}" for what, number in sorted(contents.dropped.items()))
    report = Report(counts, dropped, (*guesses, *height_guess))
    return imported(content, report + planned + mapped, path)


def _read(path: Path, layers: Mapping[str, LayerRule]) -> tuple[Any, _Contents]:
    """Return the library's document and what it holds."""
    try:
        ezdxf = importlib.import_module("ezdxf")
    except ImportError:
        raise MissingExtraError("DXF needs ezdxf: pip install 'wireloc[maps]'") from None
    # What the library mends in passing is no news to anybody here.
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, "", f"larger than {MAX_BYTES // 2**20} MB")
        document = ezdxf.readfile(path)
        return document, _contents(document, layers, path)
    # The library meets nonsense with whatever its parsing of groups, tables and handles runs into.
    except (ezdxf.DXFError, *NONSENSE) as error:
        raise InputError(path, "", f"not a DXF file: {error or 'cut short'}") from None
    except OSError as error:
        raise InputError(path, "", error.strerror or "not a DXF file") from None


def _contents(document: Any, layers: Mapping[str, LayerRule], path: Path) -> _Contents:
    rules = {name.upper(): rule.kind for name, rule in layers.items()}
    lines: dict[LayerKind, list[Array]] = {kind: [] for kind in LayerKind}
    ceilings: list[float] = []
    dropped: Counter[str] = Counter()
    used = {str(layer.dxf.name) for layer in document.layers}
    for number, entity in enumerate(_entities(document.modelspace())):
        if number == MAX_ENTITIES:
            raise InputError(path, "", f"more than {MAX_ENTITIES} entities")
        layer = str(entity.dxf.get("layer", "0"))
        used.add(layer)
        kind = rules.get(layer.upper()) or _kind(layer)
        what = entity.dxftype()
        if what in ("TEXT", "MTEXT"):
            text = entity.dxf.text if what == "TEXT" else entity.plain_text()
            ceilings += [float(found.replace(",", ".")) for found in _CEILING.findall(text)]
        elif kind is None:
            dropped[f"{what} on layer {layer}"] += 1
        elif kind is not LayerKind.IGNORE:
            line = _line(entity, what)
            if line is None or len(line) < 2 or not (np.abs(line) < MAX_COORDINATE).all():
                dropped[f"{what} on layer {layer} (not straight)"] += 1
            else:
                lines[kind].append(line)
    for name in layers:
        if name.upper() not in {layer.upper() for layer in used}:
            raise InputError(path, f"layer {name}", "no such layer")
    if not lines[LayerKind.WALL]:
        known = ", ".join(sorted(used)[:20])
        raise InputError(path, "", f"no lines on a layer of walls (--layer NAME=wall); layers: {known}")
    return _Contents({kind: tuple(found) for kind, found in lines.items()}, tuple(ceilings), dropped)


def _entities(layout: Any, depth: int = 8) -> Iterator[Any]:
    """Yield the entities, those inside of placed blocks too."""
    for entity in layout:
        if entity.dxftype() == "INSERT" and depth:
            yield from _entities(entity.virtual_entities(), depth - 1)
        else:
            yield entity


def _kind(layer: str) -> LayerKind | None:
    name = layer.upper()
    return next((kind for kind, words in LAYER_WORDS.items() if any(word in name for word in words)), None)


def _line(entity: Any, what: str) -> Array | None:
    """Return the corners (N, 2) of a straight or closed line in drawing units, None for anything else."""
    if what == "LINE":
        return _plan([entity.dxf.start, entity.dxf.end])
    if what == "LWPOLYLINE" and not entity.has_arc:
        points = list(entity.vertices_in_wcs())
    elif what == "POLYLINE" and entity.is_2d_polyline and not entity.has_arc:
        points = list(entity.points_in_wcs())
    else:
        return None
    return _plan(points + points[:1] if entity.is_closed else points)


def _plan(points: Sequence[Any]) -> Array:
    return np.array([(point.x, point.y) for point in points]).reshape(-1, 2)


def _unit(document: Any, contents: _Contents, told_m: float | None) -> tuple[float, tuple[str, ...]]:
    if told_m is not None:
        return told_m, ()
    unit = UNITS_M.get(int(document.header.get("$INSUNITS", 0)))
    if unit is not None:
        return unit, ()
    extent = float(np.ptp(np.concatenate(contents.lines[LayerKind.WALL]), axis=0).max())
    unit, name = (1e-3, "millimetres") if extent > MAX_METRES else (1.0, "metres")
    return unit, (f"the drawing tells no unit ($INSUNITS); {extent:.0f} wide, it must be in {name}",)


def _height(
    ceilings: Sequence[float], unit_m: float, told_m: float | None
) -> tuple[float, bool, tuple[str, ...]]:
    """Return the walls' height, whether it is told, and a sentence where it is not."""
    if told_m is not None:
        return told_m, True, ()
    heights = sorted({round(value * unit_m, 4) for value in ceilings})
    if len(heights) == 1 and math.isfinite(heights[0]) and 1.0 < heights[0] < 20.0:
        return heights[0], True, (f"the wall height, {heights[0]} m, is that of a text in the drawing",)
    what = f" (texts tell {', '.join(map(str, heights))})" if heights else ""
    guess = f"the wall height, {GUESSED_WALL_HEIGHT_M} m{what}: tell it with --wall-height"
    return GUESSED_WALL_HEIGHT_M, False, (guess,)
