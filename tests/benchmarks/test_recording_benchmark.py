"""What recording a run costs: bytes a frame, and time beside that of a fix.

The bundled session is run once, and what its log was told is told to a recording again. Times are the processor's,
all threads of a recording included: others may run meanwhile. `make bench` prints the figures; pytest on this file
with `--benchmark-only -s` these alone.
"""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import process_time, thread_time

import pytest

from maps.regioncache import cached_regions
from runs.config import RunConfig
from runs.evaluation import read_truth
from runs.recording import RerunLog
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import Session, read_session
from vision.images import read_image
from vision.matcher import LineMatcher

#: What a frame of 640 x 480 may take of a file, and what recording it may take of a look's time, in the thread that
#: looks: pictures are encoded beside it.
MOST_BYTES, MOST_SHARE = 45_000, 0.25


class Gathered(NullLog):
    """Remembers what it is told, to tell it again."""

    def __init__(self):
        self.calls = []

    def step(self, *told):
        self.calls.append(("step", told))

    def belief(self, *told):
        self.calls.append(("belief", told))

    def finish(self, *told):
        self.calls.append(("finish", told))


@pytest.fixture(scope="module")
def drive(sample: Path) -> tuple[Session, Gathered, float]:
    """Return the session, what its run told the log, and the seconds of a typical look: lines and matching alone."""
    session, gathered = read_session(sample), Gathered()
    run_session(session, RunConfig(), gathered, lambda *_: None)
    height = session.camera.mount.height_m
    regions = cached_regions(session.wire_map, (height, height))
    matcher, spent_s = LineMatcher(session.camera, session.wire_map, regions=regions), []
    for _, frame, _, window in (told for name, told in gathered.calls if name == "step"):
        image = read_image(frame.path)
        began = process_time()
        matcher.match(image, frame.stamp_ns, window)
        spent_s.append(process_time() - began)
    return session, gathered, median(spent_s)


def replay(session: Session, gathered: Gathered, path: Path) -> tuple[float, float]:
    """Record it all, and return seconds of the processor: of all threads, and of the one that tells."""
    truth = read_truth(session.folder)
    log = RerunLog(path)
    log.begin(session, RunConfig())
    began, mine = process_time(), thread_time()
    for name, told in gathered.calls:
        getattr(log, name)(*told)
    log.truth(truth)
    mine = thread_time() - mine
    log.close()
    return process_time() - began, mine


def test_recording_is_small_and_cheap(benchmark, drive, tmp_path):
    session, gathered, look_s = drive
    path = tmp_path / "run.rrd"
    all_s, mine_s = benchmark.pedantic(replay, (session, gathered, path), rounds=3)
    frames = len(session.frames)
    size, share = path.stat().st_size / frames, mine_s / frames / look_s
    figures = {
        "bytes a frame": round(size),
        "ms a frame": round(1e3 * all_s / frames, 2),
        "ms a frame in the run's own thread": round(1e3 * mine_s / frames, 2),
        "ms a look": round(1e3 * look_s, 2),
        "share of a look": round(share, 3),
        "share with all threads": round(all_s / frames / look_s, 3),
    }
    benchmark.extra_info.update(figures)
    print("\n", figures)
    assert size <= MOST_BYTES
    assert share <= MOST_SHARE
