"""A run shown while it goes: in a process of its own, so that no viewer can make the estimator wait.

A viewer that hangs keeps rerun's connection to it, and with it the process that holds it, from ending. So that
process is another one, fed through a queue that is never waited for: where it is full, looks are not shown.
"""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, replace
from multiprocessing.queues import Queue
from queue import Full
from typing import Any

from maps.errors import InputError
from maps.outcomes import Outcome, PoseBelief, SearchWindow
from runs.config import RunConfig
from runs.logdetail import LogDetail
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.session import Frame, Session

#: How many calls may wait, a few seconds' worth; odometry makes most of them.
BACKLOG = 2000
#: How long the end of a run may take to reach the viewer.
END_S = 10.0

_Call = tuple[str, tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class _Held:
    """The bytes of an image that is no file of its own."""

    data: bytes

    def read(self) -> bytes:
        """Return them."""
        return self.data


class LiveLog:
    """Pass a run on to the viewer at a URL; a `runs.runlog.RunLog` with `truth` and `close` as `RerunLog` has."""

    def __init__(self, url: str, detail: LogDetail = LogDetail.FULL) -> None:
        """Start the process that talks to the viewer; `url` as `runs.viewer.viewer_url` gives it."""
        context = multiprocessing.get_context("spawn")
        self._calls: Queue[_Call] = context.Queue(BACKLOG)
        self._process = context.Process(target=_serve, args=(self._calls, url, detail), daemon=True)
        self._process.start()
        #: How many calls were dropped because the viewer did not keep up.
        self.dropped = 0

    def begin(self, session: Session, config: RunConfig) -> None:
        """Pass on, without pictures: each comes with its look, and may hang on an open file."""
        frames = tuple(replace(frame, picture=None) for frame in session.frames)
        self._pass("begin", replace(session, frames=frames), config)

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Pass on."""
        if frame is not None:
            frame = replace(frame, path=frame.path.resolve(), picture=_held(frame))
        self._pass("step", record, frame, outcome, window)

    def belief(self, belief: PoseBelief) -> None:
        """Pass on."""
        self._pass("belief", belief)

    def finish(self, trajectories: Trajectories) -> None:
        """Pass on."""
        self._pass("finish", trajectories)

    def truth(self, truth: Trajectory) -> None:
        """Pass on."""
        self._pass("truth", truth)

    def close(self) -> None:
        """Give the viewer some time to get the rest, and end."""
        self._pass("close")
        self._process.join(END_S)
        self._process.kill()
        self._calls.cancel_join_thread()
        self._calls.close()

    def _pass(self, method: str, *arguments: Any) -> None:
        try:
            self._calls.put_nowait((method, arguments))
        except Full:
            self.dropped += 1


def _held(frame: Frame) -> _Held | None:
    """Return a frame's picture if it is no file; one that cannot be read is not shown."""
    try:
        return None if frame.picture is None else _Held(frame.data())
    except InputError:
        return None


def _serve(calls: Queue[_Call], url: str, detail: LogDetail) -> None:
    """Do in this process what the other one asks for, until it closes."""
    # Not needed where the calls come from, and slow to load.
    from runs.recording import RerunLog

    log, method = RerunLog(url, detail), ""
    while method != "close":
        method, arguments = calls.get()
        getattr(log, method)(*arguments)
