"""The run folder: written beside its place while the run goes, put there when it is whole."""

from __future__ import annotations

import csv
import json
import os
import shutil
from dataclasses import astuple
from datetime import datetime
from decimal import Decimal
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from maps.errors import InputError
from maps.outcomes import Outcome, PoseBelief, SearchWindow
from runs.config import RunConfig, write_config
from runs.folderlock import lock_folder
from runs.runlog import COLUMNS, StepRecord, Trajectories, Trajectory
from runs.session import Frame, Session
from runs.tracks import headings_known

RESULTS = Path("results")


class StagedFolder:
    """A folder that is there whole or not at all: `with StagedFolder(out) as partial`.

    What is written goes to `<out>.partial`, renamed to `out` at the end and removed on an error. A run
    that is killed leaves it, for people to read; the next run to the same place replaces it. While one
    is at it, another is refused.
    """

    def __init__(self, out: Path) -> None:
        """Refuse an `out` that holds something already: InputError."""
        self.named, self.out = out, out.resolve()
        self.partial = self.out.with_name(f"{self.out.name}.partial")
        self._lock: int | None = None
        self._refuse_taken()

    def __enter__(self) -> Path:
        """Make the partial folder; InputError where another run holds it, or nothing can be written."""
        self._lock = lock_folder(self.partial, self.named)
        try:
            # The other one may have been done between the first look and the lock.
            self._refuse_taken()
            for left in self.partial.iterdir():
                shutil.rmtree(left) if left.is_dir() and not left.is_symlink() else left.unlink()
        except InputError:
            self._take_away()
            raise
        except OSError as error:
            self._unlock()
            raise InputError(self.partial, "", error.strerror or str(error)) from None
        return self.partial

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put it in its place, or take it away."""
        if kind is not None and issubclass(kind, Exception):
            self._take_away()
            return
        try:
            if kind is None:
                if self.out.exists():
                    self.out.rmdir()
                self.partial.rename(self.out)
        finally:
            self._unlock()

    def _refuse_taken(self) -> None:
        if self.out.exists() and not self.out.is_dir():
            raise InputError(self.named, "", "is there already, and is not a folder")
        if self.out.is_dir() and any(self.out.iterdir()):
            raise InputError(self.named, "", "is there already, and is not empty")

    def _take_away(self) -> None:
        shutil.rmtree(self.partial, ignore_errors=True)
        self._unlock()

    def _unlock(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


class FileLog:
    """Write a run's text files into a folder as it goes; a `runs.runlog.RunLog`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._steps = folder / "steps.csv"

    def begin(self, session: Session, config: RunConfig) -> None:
        """Write the configuration, the map and the header of the steps."""
        write_config(self._folder / "config.yaml", config, _told(session))
        if session.map_path is not None:
            shutil.copyfile(session.map_path, self._folder / "map.yaml")
        self._write_row(COLUMNS)

    def step(
        self,
        record: StepRecord,
        frame: Frame | None,  # noqa: ARG002 - pictures and pairs are for recordings
        outcome: Outcome,  # noqa: ARG002
        window: SearchWindow | None,  # noqa: ARG002
    ) -> None:
        """Append a row, closed at once: a run that is killed leaves what it did."""
        stamp_ns, arrival_ns, *cells = astuple(record)
        self._write_row((seconds(stamp_ns), seconds(arrival_ns), *cells))

    def belief(self, belief: PoseBelief) -> None:
        """Wait for the trajectory."""

    def finish(self, trajectories: Trajectories) -> None:
        """Write the trajectories."""
        for name, trajectory in trajectories.by_name().items():
            write_tum(self._folder / f"{name}.tum", trajectory)

    def _write_row(self, cells: tuple[Any, ...]) -> None:
        with self._steps.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(cells)


def seconds(stamp_ns: int) -> str:
    """Write nanoseconds as seconds with nine decimals, exactly."""
    return format(Decimal(stamp_ns).scaleb(-9), "f")


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write `timestamp tx ty tz qx qy qz qw` rows; a heading that is not known is the identity."""
    with path.open("w", encoding="utf-8") as file:
        for stamp_ns, (x, y, phi) in zip(trajectory.stamps_ns, headings_known(trajectory), strict=True):
            half = 0.0 if np.isnan(phi) else phi / 2.0
            turned = f"{np.sin(half):.12f} {np.cos(half):.12f}"
            file.write(f"{seconds(int(stamp_ns))} {x:.9f} {y:.9f} 0 0 0 {turned}\n")


def write_metrics(path: Path, metrics: dict[str, Any]) -> None:
    """Write metrics.json; what there is not is null, never NaN."""
    path.write_text(json.dumps(metrics, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def default_folder(session: str, now: datetime) -> Path:
    """Return results/<session>-<time>, numbered where it is taken."""
    name = f"{session}-{now:%Y%m%d-%H%M%S}"
    names = (name if number == 1 else f"{name}-{number}" for number in count(1))
    return next(RESULTS / name for name in names if not (RESULTS / name).exists())


def point_latest(run: Path) -> None:
    """Let results/latest point to a run beside it, in one step; a real folder of that name stays."""
    latest, fresh = run.with_name("latest"), run.with_name("latest.new")
    if latest.exists() and not latest.is_symlink():
        return
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(run.name, target_is_directory=True)
    fresh.replace(latest)


def _told(session: Session) -> dict[str, Any]:
    """Return what the run was told beside its parameters: the session, and where it begins."""
    told: dict[str, Any] = {"session": session.name, "folder": str(session.folder.resolve())}
    if session.initial is not None:
        pose, deviations = session.initial.pose, np.sqrt(np.diag(session.initial.covariance))
        phi_rad, std_phi_rad = (
            (pose.phi, float(deviations[2])) if session.initial.measured[2] else (None, None)
        )
        told["initial_pose"] = {
            "x_m": pose.x,
            "y_m": pose.y,
            "phi_rad": phi_rad,
            "std_x_m": float(deviations[0]),
            "std_y_m": float(deviations[1]),
            "std_phi_rad": std_phi_rad,
        }
    return told
