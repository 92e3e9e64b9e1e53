"""Many runs: sessions, configurations, seeds and faults, each combination an item that knows all it needs."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from maps.errors import WirelocError
from runs.config import RunConfig, read_config
from runs.evaluation import evaluate, read_truth
from runs.faults.judging import Judgement, judged, judged_undisturbed
from runs.faults.kinds import chosen_fault, corrupted, fault_span
from runs.faults.recording import read_recording
from runs.faults.writing import write_recording
from runs.opening import Reading, open_session, reading_of
from runs.runlog import LogGroup
from runs.runner import RunResult, run_session
from runs.session import Session, read_session

logger = logging.getLogger(__name__)

#: The item's name where there is no fault, or no configuration.
NONE, DEFAULT = "none", "default"
#: A row of the results: what was run, and what came of it; None for what is not known.
Row = dict[str, str | int | float | None]


@dataclass(frozen=True, slots=True)
class Item:
    """One run. `session`: what holds the drive; `map_path`: None for its own map; `config`: None for the defaults.

    `seed`: the run's, and the fault's. `fault`: its kind, or `none`. `robot_path`, `topics`, `joints`: as the options
    of the command line say how to read bags.
    """

    session: str
    map_path: str | None
    config: str | None
    seed: int
    fault: str = NONE
    robot_path: str | None = None
    topics: tuple[str, ...] = ()
    joints: str | None = None

    @property
    def reading(self) -> Reading:
        """How to read the drive."""
        map_path, robot_path = (Path(name) if name else None for name in (self.map_path, self.robot_path))
        return reading_of(map_path, robot_path, self.topics, self.joints)

    @property
    def names(self) -> Row:
        """What tells this item from others, for people."""
        return {
            "session": Path(self.session).name,
            "config": Path(self.config).stem if self.config else DEFAULT,
            "fault": self.fault,
            "seed": self.seed,
        }


@dataclass(frozen=True, slots=True)
class Sweep:
    """Items to run; called with one's number, anywhere and in any order."""

    items: tuple[Item, ...]

    def __call__(self, number: int) -> Row:
        """Run an item; what goes wrong is told in its row, so that it does not stop the others."""
        item, began = self.items[number], perf_counter()
        try:
            row = _run(item)
        except (WirelocError, OSError) as error:
            row = {"status": "failed", "error": " ".join(str(error).split())}
        except Exception as error:  # noqa: BLE001 - a fault of the program in one item must not cost the others
            logger.warning("%s: %s", item.names, traceback.format_exc())
            row = {"status": "failed", "error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        return {**item.names, **row, "seconds": perf_counter() - began}


def sweep_items(
    sessions: Sequence[Path],
    configs: Sequence[Path],
    seeds: int,
    faults: Sequence[str],
    map_path: Path | None = None,
    robot_path: Path | None = None,
    topics: Sequence[str] = (),
    joints: str | None = None,
) -> tuple[Item, ...]:
    """Return all combinations; without configurations the defaults, without faults none.

    InputError for a fault that is not known, a configuration that cannot be read, or `topics` and `joints` that are
    not of their form.
    """
    reading_of(map_path, robot_path, topics, joints)
    for config in configs:
        read_config(config)
    for fault in faults:
        if fault != NONE:
            chosen_fault(fault)
    return tuple(
        Item(
            str(session.resolve()),
            _resolved(map_path),
            _resolved(config),
            seed,
            fault,
            _resolved(robot_path),
            tuple(topics),
            joints,
        )
        for session in sessions
        for config in (configs or (None,))
        for fault in (faults or (NONE,))
        for seed in range(seeds)
    )


def _resolved(path: Path | None) -> str | None:
    return str(path.resolve()) if path else None


def _run(item: Item) -> Row:
    config = read_config(Path(item.config)) if item.config else RunConfig()
    config = replace(config, seed=item.seed)
    drive = Path(item.session)
    if item.fault == NONE:
        session = open_session(drive, item.reading)
        result, metrics = _result(session, config)
        return _row(session, result, metrics, judged_undisturbed(session, result, read_truth(session.folder)))
    original = read_recording(drive, item.reading)
    fault = chosen_fault(item.fault)
    span = fault_span(original, fault)
    faulty = corrupted(original, item.fault, span, item.seed)
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / original.session.name
        write_recording(original, faulty, place, {}, _nobody)
        session = read_session(place)
        result, metrics = _result(session, config)
        judgement = judged(faulty, span, result, read_truth(session.folder), fault.obscures)
    return _row(session, result, metrics, judgement)


def _result(session: Session, config: RunConfig) -> tuple[RunResult, dict[str, Any]]:
    truth = read_truth(session.folder)
    result = run_session(session, config, LogGroup(()), _nobody)
    return result, evaluate(session, result, truth)


def _row(session: Session, result: RunResult, metrics: dict[str, Any], judgement: Judgement) -> Row:
    vision, states = metrics["vision"], metrics["states"]
    row: Row = {
        "status": "ok" if result.usable else "no fix accepted",
        "error": None,
        "frames": len(session.frames) + len(session.fixes),
        **{name: vision[name] for name in ("fixes", "partial", "ambiguous", "accepted", "rejected")},
        **{name: vision[name] for name in ("wrong", "wrong_accepted")},
        **{f"{state.lower()}_s": seconds for state, seconds in states.items()},
        "availability": metrics["availability"],
        "tracking_wrong_s": metrics["tracking_wrong_s"],
        "wrong_settled_s": judgement.wrong_s,
        "wrong_looks": judgement.wrong_looks,
        "recovered_after": judgement.recovered_after,
        "looks_after": judgement.looks_after,
        "lost_after": judgement.lost_after,
        "astray": judgement.astray,
        "fix_ms": metrics["timing_ms"]["fix"]["median"],
    }
    for track in ("odometry", "filtered", "smoothed"):
        for unit, quantity in (("m", "position_error_m"), ("deg", "heading_error_deg")):
            for statistic in ("median", "p95", "max", "rmse"):
                row[f"{track}_{statistic}_{unit}"] = metrics[track][quantity][statistic]
    return row


def _nobody(done: int, total: int) -> None:
    """Tell nobody how far it is."""
