"""What every experiment leaves behind: a JSON file, a page with its tables and figures, and the figures."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from runs.page import heading, note, page, table
from runs.plots import png, svg


@dataclass(frozen=True, slots=True)
class Grid:
    """A table of texts, for the terminal and for the page."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A figure: the name of its file, its title, and what to know when looking at it."""

    name: str
    title: str
    figure: Figure
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """An experiment's outcome, ready to be written: `content` goes into JSON, None for what is not known."""

    name: str
    title: str
    content: dict[str, Any]
    grids: tuple[Grid, ...]
    drawings: tuple[Drawing, ...]
    rows: tuple[tuple[object, ...], ...]

    def write(self, folder: Path) -> None:
        """Write <name>.json, report.html, a PNG for each figure and, trial by trial, trials.csv."""
        text = json.dumps(self.content, indent=1, allow_nan=False)
        (folder / f"{self.name}.json").write_text(text + "\n", encoding="utf-8")
        (folder / "report.html").write_text(page(self.title, self._parts()), encoding="utf-8")
        for drawing in self.drawings:
            (folder / f"{drawing.name}.png").write_bytes(png(drawing.figure))
        with (folder / "trials.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(self.rows)

    def _parts(self) -> Iterable[str]:
        for grid in self.grids:
            yield from (heading(grid.title), table(grid.header, grid.rows))
            if grid.remark:
                yield note(grid.remark)
        for drawing in self.drawings:
            yield from (heading(drawing.title), svg(drawing.figure))
            if drawing.remark:
                yield note(drawing.remark)


def figure_text(value: float | None, digits: int = 2) -> str:
    """Write a figure for a table: a dash where there is none, thousands set apart."""
    return "-" if value is None else f"{value:,.{digits}f}"
