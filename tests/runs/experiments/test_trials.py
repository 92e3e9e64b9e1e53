"""Trials give the same results wherever they run, and say in one line what is missing."""

from __future__ import annotations

import os
import sys
import warnings

import numpy as np
import pytest

from maps.errors import InputError, MissingExtraError
from runs.experiments.trials import run_trials


def trial(number: int) -> float:
    return float(np.random.default_rng(np.random.SeedSequence(3, spawn_key=(number,))).random())


def refused(number: int) -> float:
    raise InputError("hall.yaml", "floor", f"no room for trial {number}")


def silent(done: int, total: int) -> None:
    """Show no progress."""


def test_two_processes_find_what_one_finds_and_report_progress() -> None:
    told: list[tuple[int, int]] = []
    alone = run_trials(trial, 9, lambda done, total: told.append((done, total)))
    assert told == [(done, 9) for done in range(10)]
    assert len(set(alone)) == 9
    assert run_trials(trial, 9, silent, workers=2) == alone


def test_bad_input_comes_back_from_other_processes_as_it_is() -> None:
    with pytest.raises(InputError, match=r"^hall.yaml: floor: no room for trial 0$"):
        run_trials(refused, 1, silent, workers=2)


def ended(number: int) -> float:  # noqa: ARG001
    os._exit(3)


def test_a_process_that_is_ended_is_told() -> None:
    with pytest.raises(InputError, match=r"^--workers: 2: a process was ended"):
        run_trials(ended, 3, silent, workers=2)


def test_a_cluster_finds_the_same() -> None:
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        # What a cluster says of ports and of closing is not this test's.
        warnings.simplefilter("ignore")
        cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
        with cluster:
            found = run_trials(trial, 9, silent, scheduler=cluster.scheduler_address)
    assert found == run_trials(trial, 9, silent)


def test_without_the_extra_one_process_still_works(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("joblib", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"wireloc\[study\]"):
        run_trials(trial, 3, silent, workers=2)
    with pytest.raises(MissingExtraError, match=r"wireloc\[study\]"):
        run_trials(trial, 3, silent, scheduler="tcp://127.0.0.1:1")
    assert len(run_trials(trial, 3, silent)) == 3


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x", "127.0.0.1:notaport"])
def test_a_scheduler_that_is_not_there_is_told(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runs.experiments.trials._CONNECT_S", 1)
    with pytest.raises(InputError, match="--scheduler"):
        run_trials(trial, 3, silent, scheduler=address)
