"""A robot that never goes home: hours of odometry, fixes and images, without growth of memory or of time per step.

`WIRELOC_LONG_HOURS=8 pytest -m slow -s tests/runs/test_longrun.py -k images` is a working day with the matcher.
"""

from __future__ import annotations

import gc
import math
import os
import resource
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import pytest

from localization.localizer import Localizer, LocalizerConfig
from localization.odometry import OdometryNoise, WheelGeometry, wheel_step
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.config import RunConfig
from runs.evaluation import evaluate
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import Session, read_session
from runs.simulation.fixes import FixErrors
from runs.simulation.synthetic import SessionPlan, SyntheticSession, simulate_session

RATE_HZ = 50
WHEELS = WheelGeometry(0.05, 0.05, 0.34)
STD = (0.03, 0.03, 0.01)


def drive(seconds: int, per_minute: int = 60) -> tuple[list[float], list[float], Localizer]:
    """Drive circles with a fix a second, no fix in one of five; return memory [MB] and milliseconds by the minute."""
    rng = np.random.default_rng(5)
    localizer = Localizer(PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag(STD) ** 2), LocalizerConfig())
    noise, period_ns = OdometryNoise(), 10**9 // RATE_HZ
    turn_rad, forward_m = 0.2 / RATE_HZ, 0.4 / RATE_HZ
    left, right = ((forward_m + side * turn_rad * 0.17) / 0.05 for side in (-1.0, 1.0))
    memory, spent = [], []
    began = perf_counter()
    for row in range(seconds * RATE_HZ):
        start_ns, stamp_ns = row * period_ns, (row + 1) * period_ns
        localizer.predict(wheel_step(start_ns, stamp_ns, left, right, WHEELS, noise))
        localizer.estimate_at(stamp_ns)
        if (row + 1) % RATE_HZ == 0:
            localizer.windows_at(stamp_ns)
            localizer.fuse(look(row, stamp_ns, turn_rad, forward_m, rng), None, stamp_ns)
        if (row + 1) % (RATE_HZ * per_minute) == 0:
            memory.append(resident_mb())
            spent.append((perf_counter() - began) * 1e3 / (RATE_HZ * per_minute))
            began = perf_counter()
    return memory, spent, localizer


def look(row: int, stamp_ns: int, turn_rad: float, forward_m: float, rng: np.random.Generator) -> Fix | NoFix:
    """What a camera would have found."""
    if rng.random() < 0.2:
        return NoFix(Reason.TOO_FEW_SEGMENTS)
    phi, radius = (row + 1) * turn_rad, forward_m / turn_rad
    pose = np.array([radius * math.sin(phi), radius * (1.0 - math.cos(phi)), phi]) + rng.normal(size=3) * STD
    return Fix(PoseBelief(stamp_ns, Pose2.from_array(pose), np.diag(STD) ** 2))


def resident_mb() -> float:
    """Return the memory that this process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def check(memory: list[float], spent: list[float], localizer: Localizer, seconds: int) -> None:
    """What must hold after the first minute."""
    print(f"{memory[0]:.1f} MB after a minute, {max(memory):.1f} MB at most")
    print(f"{spent[0]:.3f} ms a step in the first minute, {spent[-1]:.3f} ms in the last")
    assert max(memory) - memory[0] < 50.0
    quarter = max(len(spent) // 4, 1)
    assert np.median(spent[-quarter:]) < 2.0 * np.median(spent[:quarter])
    belief = localizer.belief_at(seconds * 10**9)
    assert belief is not None
    phi = seconds * 0.2
    assert math.hypot(belief.pose.x - 2.0 * math.sin(phi), belief.pose.y - 2.0 * (1.0 - math.cos(phi))) < 0.2


def test_ten_minutes_neither_grow_nor_slow_down() -> None:
    check(*drive(600), 600)


@pytest.mark.slow
def test_eight_hours_neither_grow_nor_slow_down() -> None:
    check(*drive(8 * 3600), 8 * 3600)


@dataclass
class Watch:
    """The progress of a run: memory and processor time of an odometry step by the minute, printed by the hour."""

    looks_a_minute: float
    steps_a_minute: float
    minutes: int = 0
    began: float = field(default_factory=process_time)
    memory: list[float] = field(default_factory=list)
    spent: list[float] = field(default_factory=list)

    def __call__(self, done: int, _total: int) -> None:
        """Take note where a minute is over; what comes when all looks are done is no matter of the loop's."""
        if done < self.looks_a_minute * (self.minutes + 1):
            return
        self.minutes += 1
        now = process_time()
        self.spent.append((now - self.began) * 1e3 / self.steps_a_minute)
        self.memory.append(anonymous_mb())
        self.began = now
        if self.minutes % 60 == 0 or self.minutes in (1, 10):
            print(
                f"{self.minutes / 60:.2f} h: {self.memory[-1]:.1f} MB, {self.spent[-1]:.3f} ms a step, "
                f"median of the last hour {np.median(self.spent[-60:]):.3f} ms",
                flush=True,
            )

    def check(self, settled: int = 1) -> None:
        """Demand what must hold once that many minutes are over."""
        memory, spent = self.memory[settled - 1 :], self.spent[settled:]
        assert len(memory) >= 3
        print(f"{memory[0]:.1f} MB after {settled} min, {max(memory):.1f} MB at most", flush=True)
        assert max(memory) - memory[0] < 50.0
        quarter = max(len(spent) // 4, 1)
        assert np.median(spent[-quarter:]) < 2.0 * np.median(spent[:quarter])


def anonymous_mb() -> float:
    """Return the memory that is this process's own: what is mapped from files is not."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("RssAnon"))
    return int(line.split()[1]) / 1024.0


def hours(otherwise: float) -> float:
    """Return how long to drive, in simulated hours."""
    return float(os.environ.get("WIRELOC_LONG_HOURS", otherwise))


def fixes_alone(seconds: float, rate_hz: float = 1.0) -> SyntheticSession:
    """Return a session without images, wrong fixes and gaps among them."""
    errors = FixErrors(rate_hz=rate_hz, outlier_share=0.02, gaps_s=((100.0, 130.0),), delay_s=(0.05, 0.3))
    return simulate_session(np.random.default_rng(8), SessionPlan(seconds=seconds, fixes=errors))


def there_and_back(session: Session, seconds: float) -> Session:
    """Return a session of that length that drives a session's way to its end, back, and on so; images repeat."""
    odometry = session.odometry
    first_ns, last_ns = int(odometry.stamps_ns[0]), int(odometry.stamps_ns[-1])
    period_ns = last_ns - first_ns
    stamps, values, frames = [odometry.stamps_ns[:1]], [odometry.values[:1]], []
    for lap in range(math.ceil(seconds * 1e9 / period_ns)):
        begin_ns = first_ns + lap * period_ns
        back, order = lap % 2, slice(None, None, -1 if lap % 2 else 1)
        since = odometry.stamps_ns - first_ns
        stamps.append(begin_ns + (period_ns - since if back else since)[order][1:])
        values.append(odometry.values[order][1:])
        for frame in session.frames[order]:
            since_ns = last_ns - frame.stamp_ns if back else frame.stamp_ns - first_ns
            if 0 < since_ns < period_ns:
                frames.append(replace(frame, stamp_ns=begin_ns + since_ns, arrival_ns=begin_ns + since_ns))
    stamps_ns = np.concatenate(stamps)
    odometry = replace(odometry, stamps_ns=stamps_ns, arrivals_ns=stamps_ns, values=np.concatenate(values))
    return replace(session, odometry=odometry, frames=tuple(frames))


def most_blocks(session: Session) -> list[int]:
    """Return the most blocks of memory that Python held in each quarter of a run's looks."""
    held: list[list[int]] = [[], [], [], []]

    def note(done: int, total: int) -> None:
        held[(4 * done - 1) // total].append(sys.getallocatedblocks())

    gc.collect()
    run_session(session, RunConfig(), NullLog(), note)
    return [max(blocks) for blocks in held]


def test_a_run_holds_no_more_in_its_last_quarter_than_in_its_second() -> None:
    session = fixes_alone(80.0, rate_hz=5.0).session
    blocks = most_blocks(session)
    assert blocks[3] - blocks[1] < 6_000, "steps and beliefs kept as lists are ten times as many"


@pytest.mark.slow
def test_hours_of_fixes_through_a_whole_run() -> None:
    simulated = fixes_alone(3600.0 * hours(8.0))
    session = simulated.session
    seconds = (session.odometry.stamps_ns[-1] - session.start_ns) / 1e9
    watch = Watch(60.0 * len(session.fixes) / seconds, 60.0 * len(session.odometry.stamps_ns) / seconds)
    result = run_session(session, RunConfig(), NullLog(), watch)
    print(f"smoothed: {anonymous_mb():.1f} MB", flush=True)
    metrics = evaluate(session, result, simulated.drive.truth())
    watch.check()
    assert metrics["availability"] > 0.99
    assert (
        metrics["smoothed"]["position_error_m"]["rmse"]
        < metrics["filtered"]["position_error_m"]["rmse"]
        < 0.1
    )


@pytest.mark.slow
def test_hours_of_images_through_a_whole_run(sample: Path) -> None:
    session = there_and_back(read_session(sample), 3600.0 * hours(1.0 / 6.0))
    seconds = (session.odometry.stamps_ns[-1] - session.start_ns) / 1e9
    watch = Watch(60.0 * len(session.frames) / seconds, 60.0 * len(session.odometry.stamps_ns) / seconds)
    result = run_session(session, RunConfig(), NullLog(), watch)
    print(f"smoothed: {anonymous_mb():.1f} MB", flush=True)
    watch.check()
    accepted = sum(record.accepted for record in result.records)
    assert accepted > 0.5 * len(result.records)
