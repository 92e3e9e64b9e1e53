"""A run folder read back: what comparison and report know of a run."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maps.documents import read_text
from maps.errors import InputError
from maps.mapfile import read_map
from maps.outcomes import FIX_POSITION_STD_M
from maps.poses import Array
from maps.wiremap import WireMap
from runs.palette import OPTIONAL_TRACKS, TRACKS
from runs.runlog import COLUMNS, Trajectory
from runs.tables import MAX_TIME_S

#: A row of steps.csv by column; an empty cell is what there was not.
Step = dict[str, str]

TUM_COLUMNS = 8


@dataclass(frozen=True, slots=True, eq=False)
class RunFolder:
    """One run as its folder tells it.

    `tracks` by the names of `runs.palette.TRACKS`, those that it has; a heading that was not measured is NaN.
    `truth` and `wire_map` are None where the run had none. `metrics` is metrics.json.
    """

    path: Path
    name: str
    tracks: dict[str, Trajectory]
    truth: Trajectory | None
    wire_map: WireMap | None
    steps: tuple[Step, ...]
    metrics: dict[str, Any]

    @property
    def reference(self) -> Trajectory:
        """What errors are measured against: the truth, or the smoothed track where there is none."""
        return self.truth if self.truth is not None else self.tracks["smoothed"]

    @property
    def reference_name(self) -> str:
        """What to call the reference."""
        return "truth" if self.truth is not None else "smoothed"

    @property
    def whole_fixes(self) -> Trajectory:
        """The fixes that are whole in what they measured: all of a pose, or its position alone."""
        stamps = [to_ns(step["timestamp_s"]) for step in self.steps if _is_whole(step)]
        vision = self.tracks["vision"]
        rows = np.isin(vision.stamps_ns, stamps)
        return Trajectory(vision.stamps_ns[rows], vision.poses[rows])


def read_run(folder: Path) -> RunFolder:
    """Read a run folder; InputError names the file, and the line, of what is missing or is not as written."""
    if not folder.is_dir():
        raise InputError(folder, "", "no such run folder")
    steps = read_steps(folder)
    paths = {name: folder / f"{name}.tum" for name in TRACKS}
    tracks = {
        name: read_tum(path) for name, path in paths.items() if name not in OPTIONAL_TRACKS or path.exists()
    }
    blind = [to_ns(step["timestamp_s"]) for step in steps if step["fix_x_m"] and not step["fix_phi_rad"]]
    tracks["vision"] = _without_headings(tracks["vision"], np.isin(tracks["vision"].stamps_ns, blind))
    metrics = _read_metrics(folder / "metrics.json")
    map_path = folder / "map.yaml"
    return RunFolder(
        path=folder,
        name=folder.resolve().name,
        tracks=tracks,
        truth=_read_truth(folder / "truth.tum", metrics),
        wire_map=read_map(map_path) if map_path.exists() else None,
        steps=steps,
        metrics=metrics,
    )


def read_steps(folder: Path) -> tuple[Step, ...]:
    """Read steps.csv, a row a look."""
    path = folder / "steps.csv"
    reader = csv.DictReader(StringIO(read_text(path)))
    try:
        missing = set(COLUMNS) - set(reader.fieldnames or ())
        if missing:
            raise InputError(path, "line 1", f"no column {min(missing)}")
        return tuple(reader)
    except csv.Error as error:
        raise InputError(path, f"line {reader.line_num}", f"not CSV: {error}") from None


def read_tum(path: Path) -> Trajectory:
    """Read a TUM trajectory: rows of `timestamp tx ty tz qx qy qz qw`, seconds and metres."""
    stamps_ns: list[int] = []
    poses: list[tuple[float, float, float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words or line.startswith("#"):
            continue
        try:
            if len(words) != TUM_COLUMNS:
                raise ValueError(f"{len(words)} columns")
            stamp_ns = to_ns(words[0])
            if abs(stamp_ns) > MAX_TIME_S * 10**9:
                raise ValueError("out of range")
            x, y, _, _, _, qz, qw = (float(word) for word in words[1:])
        except ValueError:
            raise InputError(path, f"line {number}", "not `timestamp tx ty tz qx qy qz qw`") from None
        stamps_ns.append(stamp_ns)
        poses.append((x, y, 2.0 * float(np.arctan2(qz, qw))))
    return Trajectory(np.array(stamps_ns, np.int64), np.array(poses))


def to_ns(seconds: str) -> int:
    """Return decimal seconds as nanoseconds, exact to the last digit, as no float would."""
    whole, _, fraction = seconds.partition(".")
    sign = -1 if whole.startswith("-") else 1
    return int(whole or "0") * 10**9 + sign * int(f"{fraction:0<9.9}")


def _read_truth(path: Path, metrics: dict[str, Any]) -> Trajectory | None:
    """Read the truth; the metrics know whether its headings are more than what a TUM file must write."""
    if not path.exists():
        return None
    truth = read_tum(path)
    compared = metrics.get("odometry", {}).get("heading_error_deg") or {}
    blind = compared.get("rmse") is None
    return _without_headings(truth, np.full(len(truth), blind))


def _without_headings(track: Trajectory, rows: NDArray[np.bool_]) -> Trajectory:
    """Make NaN of the headings of some rows, (N,) bool."""
    poses = track.poses.copy()
    poses[rows, 2] = np.nan
    return Trajectory(track.stamps_ns, poses)


def _is_whole(step: Step) -> bool:
    if step["outcome"] == "FIX":
        return True
    if not step["fix_x_m"] or step["fix_phi_rad"]:
        return False
    return math.sqrt(float(np.linalg.eigvalsh(fix_covariance(step))[-1])) < FIX_POSITION_STD_M


def fix_covariance(step: Step) -> Array:
    """Return the covariance of a fix's position, (2, 2) [m^2]; NaN where there is none."""
    sxx, sxy, syy = (float(step[f"fix_{name}"] or "nan") for name in ("sxx", "sxy", "syy"))
    return np.array([[sxx, sxy], [sxy, syy]])


def _read_metrics(path: Path) -> dict[str, Any]:
    try:
        metrics = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(path, f"line {error.lineno}", f"not JSON: {error.msg}") from None
    if not isinstance(metrics, dict):
        raise InputError(path, "", "expected keys and values")
    return metrics
