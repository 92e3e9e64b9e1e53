"""Odometry, raw vision, filtered and smoothed poses side by side, of one run or of several."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from maps.errors import InputError
from runs.folder import RunFolder, read_run
from runs.page import STATISTICS, note, number, page, table
from runs.palette import TRACKS
from runs.plots import cumulative, plan, png, svg
from runs.tracks import Spread, errors_of, spread


@dataclass(frozen=True, slots=True)
class Row:
    """One trajectory of one run against its reference, `truth` or `smoothed`.

    `poses`: how many there are. `position_m`, `heading_deg`: their errors.
    """

    run: str
    track: str
    reference: str
    poses: int
    position_m: Spread
    heading_deg: Spread


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs side by side, and the folder where table and figures are."""

    folder: Path
    rows: tuple[Row, ...]


def compare(runs: Sequence[Path], out: Path | None = None) -> Comparison:
    """Compare runs' trajectories from their folders alone, and write table and figures to `out`.

    Writes comparison.json, comparison.html, plan.svg and plan.png; `out` is `compare` inside the first
    run by default. InputError where a run folder, or `out`, cannot be used.
    """
    folders = [read_run(run) for run in runs]
    comparison = Comparison(
        folder=out or runs[0] / "compare", rows=tuple(row for folder in folders for row in rows_of(folder))
    )
    _write(comparison, folders)
    return comparison


def rows_of(run: RunFolder) -> list[Row]:
    """Return a row for each of a run's trajectories; a reference has no errors against itself."""
    return [_row(run, name) for name in TRACKS]


def _row(run: RunFolder, name: str) -> Row:
    track = run.whole_fixes if name == "vision" else run.tracks[name]
    itself = track is run.reference
    found = errors_of(track, run.reference)
    return Row(
        run=run.name,
        track=name,
        reference=run.reference_name,
        poses=len(track),
        position_m=Spread() if itself else spread(found.position_m),
        heading_deg=Spread() if itself else spread(np.degrees(found.heading_rad)),
    )


def _write(comparison: Comparison, runs: list[RunFolder]) -> None:
    folder = comparison.folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", error.strerror or str(error)) from None
    content = {"rows": [asdict(row) for row in comparison.rows]}
    (folder / "comparison.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    drawing = plan(runs)
    (folder / "plan.svg").write_text(svg(drawing), encoding="utf-8")
    (folder / "plan.png").write_bytes(png(drawing))
    parts = [*_tables(comparison.rows), _note(comparison.rows), svg(cumulative(runs))]
    html = page("Comparison", parts)
    (folder / "comparison.html").write_text(html, encoding="utf-8")


def _tables(rows: Sequence[Row]) -> list[str]:
    several = len({row.run for row in rows}) > 1
    position = [[_label(row, several), str(row.poses), *_cells(row.position_m, 3)] for row in rows]
    heading = [[_label(row, several), str(row.poses), *_cells(row.heading_deg, 2)] for row in rows]
    return [
        table(["position, m", "poses", *STATISTICS.values()], position),
        table(["heading, deg", "poses", *STATISTICS.values()], heading),
    ]


def _label(row: Row, several: bool) -> str:
    _, label = TRACKS[row.track]
    return f"{row.run}: {label}" if several else label


def _cells(found: Spread, digits: int) -> list[str]:
    return [number(getattr(found, name), digits=digits) for name in STATISTICS]


def _note(rows: Sequence[Row]) -> str:
    """Tell what the errors are against."""
    without = sorted({row.run for row in rows if row.reference == "smoothed"})
    if not without:
        return note(
            "Errors against the ground truth. Raw vision: fixes that constrain all that they measure."
        )
    return note(f"No ground truth in {', '.join(without)}: differences from the smoothed poses, not errors.")
