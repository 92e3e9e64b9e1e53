"""What a comparison leaves: its figures as JSON and on a page, the plan as a picture, and one recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maps.errors import InputError
from runs.compareplots import innovations
from runs.comparerecording import record_comparison
from runs.folder import RunFolder
from runs.page import STATISTICS, heading, note, number, page, table
from runs.palette import TRACKS
from runs.plots import cumulative, errors_over_time, plan, png, svg

if TYPE_CHECKING:
    from runs.compare import Row

#: What has errors, by the fields of a row: what people call it, and digits.
QUANTITIES = {
    "position_m": ("position, m", 3),
    "along_m": ("along, m", 3),
    "across_m": ("across, m", 3),
    "heading_deg": ("heading, deg", 2),
}

#: The columns of a comparison's table.
HEADER = ("", "poses", "error", *STATISTICS.values(), "available, %", "wrong", "ANEES", "ms")


def write_comparison(
    folder: Path, rows: Sequence[Row], content: dict[str, Any], runs: Sequence[RunFolder]
) -> None:
    """Write all files of a comparison; InputError where the folder cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", error.strerror or str(error)) from None
    text = json.dumps(content, indent=1, allow_nan=False)
    (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")
    drawing = plan(runs)
    (folder / "plan.svg").write_text(svg(drawing), encoding="utf-8")
    (folder / "plan.png").write_bytes(png(drawing))
    parts = [
        svg(drawing),
        table(HEADER, table_rows(rows)),
        note(content["remark"]),
        heading("Errors over time"),
        *(part for run in runs for part in _over_time(run, named=len(runs) > 1)),
        heading("Shares of poses"),
        svg(cumulative(runs)),
        heading("Innovations"),
        svg(innovations(runs)),
    ]
    (folder / "comparison.html").write_text(page("Comparison", parts), encoding="utf-8")
    record_comparison(folder / "comparison.rrd", runs)


def table_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Return the comparison's table, by the columns of `HEADER`: a line for each quantity of each row."""
    several = len({row.run for row in rows}) > 1
    lines = []
    for row in rows:
        _, label = TRACKS[row.track]
        told = [f"{row.run}: {label}" if several else label, str(row.poses)]
        summary = [
            number(None if row.available is None else 100.0 * row.available, digits=1),
            "-" if row.wrong is None else str(row.wrong),
            number(row.anees, digits=2),
            number(row.ms, digits=2),
        ]
        for field, (quantity, digits) in QUANTITIES.items():
            found = getattr(row, field)
            figures = [number(getattr(found, key), digits=digits) for key in STATISTICS]
            lines.append([*told, quantity, *figures, *summary])
            # They are of the whole row, and told once.
            told, summary = ["", ""], [""] * len(summary)
    return lines


def _over_time(run: RunFolder, *, named: bool) -> list[str]:
    figure = svg(errors_over_time(run))
    return [note(run.name), figure] if named else [figure]
