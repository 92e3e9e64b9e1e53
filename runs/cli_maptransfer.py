"""What `map import` says and understands: layer rules, units, and the account of an import."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from maps.errors import InputError
from maps.formats.imported import Imported, LayerKind, LayerRule

#: What one unit of a file is in metres.
UNITS_M = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}


def layer_rules(texts: list[str]) -> dict[str, LayerRule]:
    """Return the rules in `NAME=KIND[,BOTTOM_M,TOP_M]`; InputError names the one that is not."""
    return dict(_layer_rule(text) for text in texts)


def _layer_rule(text: str) -> tuple[str, LayerRule]:
    name, _, rule = text.rpartition("=")
    kind, *heights = rule.split(",")
    try:
        numbers = [float(height) for height in heights]
        fits = len(numbers) in (0, 2) and all(math.isfinite(number) for number in numbers)
        if not name or not fits or (numbers and not 0.0 <= numbers[0] < numbers[1]):
            raise ValueError(text)
        return name, LayerRule(LayerKind(kind.strip().lower()), *numbers)
    except ValueError:
        kinds = "|".join(LayerKind)
        raise InputError("--layer", "", f"expected NAME={kinds}[,BOTTOM_M,TOP_M], not {text!r}") from None


def unit_m(name: str | None) -> float | None:
    """Return a unit's length in metres; InputError where it is not known."""
    if name is not None and name not in UNITS_M:
        raise InputError("--unit", "", f"expected one of {', '.join(UNITS_M)}, not {name!r}")
    return None if name is None else UNITS_M[name]


def wall_height(height_m: float | None) -> float | None:
    """Return a wall height that a building can have; InputError otherwise."""
    if height_m is not None and not 0.5 <= height_m <= 100.0:
        raise InputError("--wall-height", "", f"expected metres from 0.5 to 100, not {height_m:g}")
    return height_m


def content_of(result: Imported, out: Path) -> dict[str, Any]:
    """Return an import's account for programs."""
    return {"map": str(out), **asdict(result.report)}


def print_import(result: Imported, out: Path) -> None:
    """Print an import's account: counts, what was left out, what was guessed."""
    console = Console()
    report = result.report
    for name, count in report.found.items():
        number = f"{count:.3f}".rstrip("0").rstrip(".") if isinstance(count, float) else str(count)
        console.print(f"{name.replace('_', ' ')}: {number}", highlight=False)
    for heading, sentences in (("left out", report.dropped), ("guessed", report.guessed)):
        for sentence in sentences:
            console.print(f"{heading}: {sentence}", soft_wrap=True, highlight=False, markup=False)
    typer.echo(str(out))
