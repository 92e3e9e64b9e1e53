"""What `wireloc map check` says: findings as a table, figures below; or all of it for a program."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from maps.check import MapCheck, MapFigures
from maps.findings import Fault, Severity

COLOURS = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.NOTE: "cyan"}

#: Of one fault, more rows than this say nothing new.
ROWS_PER_FAULT = 12


def content_of(check: MapCheck, path: Path) -> dict[str, Any]:
    """Return findings and figures as plain values for a program."""
    counts = {f"{severity}s": check.count(severity) for severity in Severity}
    findings = [asdict(finding) for finding in check.findings]
    figures = None if check.figures is None else asdict(check.figures)
    return {"map": str(path), **counts, "findings": findings, "figures": figures}


def print_check(check: MapCheck) -> None:
    """Print findings and figures; coloured on a terminal, plain and unbroken lines in a pipe."""
    console = Console()
    if not console.is_terminal:
        # Names must not be folded away where a program may search for them.
        console.width = 10_000
    if check.findings:
        console.print(_findings_table(check))
    counts = [_count(check.count(severity), severity) for severity in Severity]
    console.print(", ".join(counts), highlight=False)
    if check.figures is not None:
        console.print(_figures_table(check.figures))


def _findings_table(check: MapCheck) -> Table:
    table = Table("", "fault", "where", "what", "to do", box=SIMPLE_HEAD)
    shown: Counter[Fault] = Counter()
    for finding in check.findings:
        shown[finding.fault] += 1
        if shown[finding.fault] <= ROWS_PER_FAULT:
            severity = Text(finding.severity, style=COLOURS[finding.severity])
            where = Text(", ".join(finding.where))
            table.add_row(severity, finding.fault, where, Text(finding.what), Text(finding.advice))
    for fault, count in shown.items():
        if count > ROWS_PER_FAULT:
            table.add_row("", fault, "", f"and {count - ROWS_PER_FAULT} more", "--json lists all")
    return table


def _figures_table(figures: MapFigures) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    kinds = ", ".join(f"{count} {kind}" for kind, count in figures.kinds.items())
    table.add_row("segments", Text(f"{figures.segments}: {kinds}"))
    table.add_row("total length", f"{figures.length_m:.1f} m")
    table.add_row("floor", f"{figures.floor_m2:.1f} m2")
    table.add_row("rooms", str(figures.rooms))
    if figures.regions is None:
        table.add_row("view regions", "not built: correct the errors first")
    else:
        regions = figures.regions
        size = f"{regions.memory_bytes / 1e6:.1f} MB"
        table.add_row("view regions", f"{regions.count}, built in {regions.build_s:.1f} s, {size}")
    return table


def _count(count: int, severity: Severity) -> str:
    word = f"{severity}" if count == 1 else f"{severity}s"
    return f"[{COLOURS[severity]}]{count} {word}[/]" if count else f"{count} {word}"
