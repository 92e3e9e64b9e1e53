"""A whole navigation run: a session in, a run folder out."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.recording import RerunLog
from runs.report import write_report
from runs.results import FileLog, StagedFolder, write_metrics, write_tum
from runs.runlog import LogGroup
from runs.runner import Progress, run_session
from runs.session import Session


@dataclass(frozen=True, slots=True)
class Navigation:
    """What came of it: `metrics` as in metrics.json; `usable` where some fix was accepted."""

    metrics: dict[str, Any]
    usable: bool


def navigate(session: Session, config: RunConfig, out: Path, progress: Progress) -> Navigation:
    """Run a session, then compare it with the truth where there is one; write it all to `out`.

    InputError, and no folder, where the input is bad; `out` must not hold anything yet.
    """
    # Read before the run, so that a malformed truth is told at once; the run itself never sees it.
    truth = read_truth(session.folder)
    with StagedFolder(out) as folder:
        with closing(RerunLog(folder / "run.rrd")) as recording:
            result = run_session(session, config, LogGroup((FileLog(folder), recording)), progress)
            if truth is not None:
                recording.truth(truth)
                write_tum(folder / "truth.tum", truth)
        metrics = evaluate(session, result, truth)
        write_metrics(folder / "metrics.json", metrics)
        write_report(folder)
    return Navigation(metrics, result.usable)
