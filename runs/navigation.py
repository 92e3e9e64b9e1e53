"""A whole navigation run: a session in, a run folder out."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runs.bags.results import McapLog
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.livelog import LiveLog
from runs.logdetail import LogDetail
from runs.recording import RerunLog
from runs.report import write_report
from runs.results import FileLog, StagedFolder, write_metrics, write_tum
from runs.runlog import LogGroup, RunLog
from runs.runner import Progress, run_session
from runs.session import Session
from runs.worst import worst_frames


@dataclass(frozen=True, slots=True)
class Watching:
    """Who watches a run: `detail` of its recording, and `viewer`, the URL of one that shows it while it goes.

    `mcap`: whether the results are written as run.mcap too.
    """

    detail: LogDetail = LogDetail.FULL
    viewer: str | None = None
    mcap: bool = False

    def recordings(self, path: Path) -> list[RerunLog | LiveLog]:
        """Open the recording, and the connection to the viewer."""
        logs: list[RerunLog | LiveLog] = []
        if self.detail is not LogDetail.OFF:
            logs.append(RerunLog(path, self.detail))
        if self.viewer is not None:
            logs.append(LiveLog(self.viewer))
        return logs

    def files(self, folder: Path) -> list[RunLog]:
        """Return what writes the run's other files; MissingExtraError where a library is missing."""
        return [FileLog(folder), *([McapLog(folder / "run.mcap")] if self.mcap else [])]


@dataclass(frozen=True, slots=True)
class Navigation:
    """What came of it: `metrics` as in metrics.json; `usable` where some fix was accepted."""

    metrics: dict[str, Any]
    usable: bool


def navigate(
    session: Session,
    config: RunConfig,
    out: Path,
    progress: Progress,
    watching: Watching | None = None,
) -> Navigation:
    """Run a session, then compare it with the truth where there is one; write it all to `out`.

    InputError, and no folder, where the input is bad; `out` must not hold anything yet.
    """
    watching = watching or Watching()
    # Read before the run, so that a malformed truth is told at once; the run itself never sees it.
    truth = read_truth(session.folder)
    with StagedFolder(out) as folder:
        with ExitStack() as open_logs:
            recordings = [
                open_logs.enter_context(closing(log)) for log in watching.recordings(folder / "run.rrd")
            ]
            result = run_session(session, config, LogGroup((*watching.files(folder), *recordings)), progress)
            if truth is not None:
                for recording in recordings:
                    recording.truth(truth)
                write_tum(folder / "truth.tum", truth)
        metrics = evaluate(session, result, truth)
        write_metrics(folder / "metrics.json", metrics)
        write_report(folder, worst_frames(session, result, truth))
    return Navigation(metrics, result.usable)
