"""Odometry, raw vision, filtered, fixed-lag and smoothed poses side by side, of one run or of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runs.comparepage import write_comparison
from runs.evaluation import WRONG_POSE_M, WRONG_POSE_RAD
from runs.folder import RunFolder, read_run
from runs.tracks import Spread, along_and_across, errors_of, spread


@dataclass(frozen=True, slots=True)
class Row:
    """One trajectory of one run against its reference, `truth` or `smoothed`.

    `poses`: how many there are. `position_m`, `heading_deg`: their errors; `along_m`, `across_m`: those of the
    position along the reference's heading and across it. `available`: the share of looks with a fix, or of the
    time with a published pose. `wrong`: fixes that the evaluation calls wrong, or poses more than 0.5 m or 10 deg
    off. `anees`: 1 where the covariances are honest. `ms`: median milliseconds of a fix, or of an update. None
    where it is not known, or says nothing of this trajectory.
    """

    run: str
    track: str
    reference: str
    poses: int
    position_m: Spread
    along_m: Spread
    across_m: Spread
    heading_deg: Spread
    available: float | None
    wrong: int | None
    anees: float | None
    ms: float | None


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs side by side, and the folder where tables, figures and recording are."""

    folder: Path
    rows: tuple[Row, ...]

    def content(self) -> dict[str, Any]:
        """Return the figures as comparison.json has them."""
        return {"rows": [asdict(row) for row in self.rows], "remark": self.remark}

    @property
    def remark(self) -> str:
        """Tell what the errors are against."""
        without = sorted({row.run for row in self.rows if row.reference == "smoothed"})
        if not without:
            return "Errors against the ground truth. Raw vision: fixes that constrain all that they measure."
        return f"No ground truth in {', '.join(without)}: differences from the smoothed poses, not errors."


def compare(runs: Sequence[Path], out: Path | None = None) -> Comparison:
    """Compare runs' trajectories from their folders alone, and write tables, figures and recording to `out`.

    Writes comparison.json, comparison.html, comparison.rrd, plan.svg and plan.png; `out` is `compare` inside the
    first run by default. InputError where a run folder, or `out`, cannot be used.
    """
    folders = named_apart([read_run(run) for run in runs])
    rows = tuple(row for folder in folders for row in rows_of(folder))
    comparison = Comparison(out or runs[0] / "compare", rows)
    write_comparison(comparison.folder, rows, comparison.content(), folders)
    return comparison


def rows_of(run: RunFolder) -> list[Row]:
    """Return a row for each of a run's trajectories; a reference has no errors against itself."""
    return [_row(run, name) for name in run.tracks]


def _row(run: RunFolder, name: str) -> Row:
    track = run.whole_fixes if name == "vision" else run.tracks[name]
    itself = track is run.reference
    found = errors_of(track, run.reference)
    along_m, across_m = along_and_across(track, run.reference)
    nothing, told = Spread(), run.metrics.get(name) or {}
    far = (found.position_m > WRONG_POSE_M) | (found.heading_rad > WRONG_POSE_RAD)
    return Row(
        run=run.name,
        track=name,
        reference=run.reference_name,
        poses=len(track),
        position_m=nothing if itself else spread(found.position_m),
        along_m=nothing if itself else spread(along_m),
        across_m=nothing if itself else spread(across_m),
        heading_deg=nothing if itself else spread(np.degrees(found.heading_rad)),
        available=_available(run, name),
        wrong=None if run.truth is None else told.get("wrong", int(far.sum())),
        anees=told.get("anees"),
        ms=_milliseconds(run, name),
    )


def _available(run: RunFolder, name: str) -> float | None:
    if name == "odometry":
        return None
    if name != "vision":
        return run.metrics.get("availability")
    looks = len(run.steps)
    return len(run.whole_fixes) / looks if looks else None


def _milliseconds(run: RunFolder, name: str) -> float | None:
    stage = {"odometry": "predict", "vision": "fix", "filtered": "update"}.get(name, "")
    median: float | None = run.metrics.get("timing_ms", {}).get(stage, {}).get("median")
    return median


def named_apart(runs: list[RunFolder]) -> list[RunFolder]:
    """Number runs of the same name, so that tables can tell them apart."""
    for name in {run.name for run in runs}:
        same = [number for number, run in enumerate(runs) if run.name == name]
        if len(same) > 1:
            for count, number in enumerate(same, start=1):
                runs[number] = replace(runs[number], name=f"{name} ({count})")
    return runs
