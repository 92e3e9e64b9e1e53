"""Many runs: sessions, configurations, seeds and faults, each combination an item that knows all it needs."""

from __future__ import annotations

import hashlib
import json
import logging
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from maps.errors import WirelocError
from runs.config import RunConfig, read_config
from runs.evaluation import evaluate, read_truth
from runs.faults.judging import Judgement, judged
from runs.faults.kinds import chosen_fault, corrupted, fault_span
from runs.faults.recording import read_recording
from runs.faults.writing import write_recording
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
    """One run. `session`: its folder; `map_path`: None for its own map; `config`: None for the defaults.

    `seed`: the run's, and the fault's. `fault`: its kind, or `none`.
    """

    session: str
    map_path: str | None
    config: str | None
    seed: int
    fault: str = NONE

    @property
    def names(self) -> Row:
        """What tells this item from others, for people."""
        return {
            "session": Path(self.session).name,
            "config": Path(self.config).stem if self.config else DEFAULT,
            "fault": self.fault,
            "seed": self.seed,
        }

    def fingerprint(self) -> str:
        """Return what changes with the program's version, the item and the files that it reads, pictures apart.

        OSError where a file cannot be read.
        """
        told = hashlib.sha256(json.dumps([version("wireloc"), asdict(self)], sort_keys=True).encode())
        paths = sorted(path for path in Path(self.session).iterdir() if path.is_file())
        for path in [*paths, *(Path(name) for name in (self.map_path, self.config) if name)]:
            told.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
        return told.hexdigest()


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
) -> tuple[Item, ...]:
    """Return all combinations; without configurations the defaults, without faults none.

    InputError for a fault that is not known, or a configuration that cannot be read.
    """
    for config in configs:
        read_config(config)
    for fault in faults:
        if fault != NONE:
            chosen_fault(fault)
    return tuple(
        Item(
            str(session.resolve()),
            str(map_path.resolve()) if map_path else None,
            str(config.resolve()) if config else None,
            seed,
            fault,
        )
        for session in sessions
        for config in (configs or (None,))
        for fault in (faults or (NONE,))
        for seed in range(seeds)
    )


def _run(item: Item) -> Row:
    config = read_config(Path(item.config)) if item.config else RunConfig()
    config = replace(config, seed=item.seed)
    folder, map_path = Path(item.session), Path(item.map_path) if item.map_path else None
    if item.fault == NONE:
        session = read_session(folder, map_path)
        return _row(session, *_result(session, config))
    original = read_recording(folder, map_path)
    span = fault_span(original, chosen_fault(item.fault))
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / folder.name
        write_recording(original, corrupted(original, item.fault, span, item.seed), place, {}, _nobody)
        session = read_session(place)
        result, metrics = _result(session, config)
        judgement = judged(original, span, result, read_truth(session.folder))
    return _row(session, result, metrics, judgement)


def _result(session: Session, config: RunConfig) -> tuple[RunResult, dict[str, Any]]:
    truth = read_truth(session.folder)
    result = run_session(session, config, LogGroup(()), _nobody)
    return result, evaluate(session, result, truth)


def _row(
    session: Session, result: RunResult, metrics: dict[str, Any], judgement: Judgement | None = None
) -> Row:
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
        "wrong_settled_s": judgement.wrong_s if judgement else metrics["tracking_wrong_s"],
        "wrong_looks": judgement.wrong_looks if judgement else None,
        "recovered_after": judgement.recovered_after if judgement else None,
        "lost_after": judgement.lost_after if judgement else None,
        "fix_ms": metrics["timing_ms"]["fix"]["median"],
    }
    for track in ("odometry", "filtered", "smoothed"):
        for unit, quantity in (("m", "position_error_m"), ("deg", "heading_error_deg")):
            for statistic in ("median", "p95", "max", "rmse"):
                row[f"{track}_{statistic}_{unit}"] = metrics[track][quantity][statistic]
    return row


def _nobody(done: int, total: int) -> None:
    """Tell nobody how far it is."""
