"""Sweeps on a Dask cluster of separate processes: the same rows, through the end of workers, clients and all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

from maps.errors import InputError
from runs.sweep import sweep_items
from runs.sweepstore import open_store, run_sweep
from tests.conftest import write_toy

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

#: Cells that differ from run to run.
TIMES = ("seconds", "fix_ms")


def nobody(done, total):
    """Show no progress."""


def figures(rows):
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


def kept(folder):
    """Return which items have a result, and when it was made."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "items").glob("*.json")}


@pytest.fixture
def cluster():
    """Return a cluster of two processes."""
    with warnings.catch_warnings():
        # What a cluster says of ports and of closing is not this test's.
        warnings.simplefilter("ignore")
        options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
        with distributed.LocalCluster(processes=True, silence_logs=50, **options) as cluster:
            yield cluster


@pytest.fixture
def drive(tmp_path):
    """Return a short toy session."""
    folder = tmp_path / "toy"
    folder.mkdir()
    write_toy(folder, 4.0)
    return folder


def end_workers(cluster):
    for worker in cluster.workers.values():
        os.kill(worker.pid, signal.SIGKILL)


def test_a_cluster_finds_the_same_though_its_workers_are_killed(cluster, drive, tmp_path):
    items = sweep_items([drive], [], 4, ["none", "slip"])

    def killing(done, total):  # noqa: ARG001
        if done == 3:
            end_workers(cluster)

    with open_store(tmp_path / "there") as folder:
        found = run_sweep(items, folder, killing, scheduler=cluster.scheduler_address)
    with open_store(tmp_path / "here") as folder:
        assert figures(found) == figures(run_sweep(items, folder, nobody))


def test_a_cluster_that_goes_away_is_told_and_what_is_done_stays(cluster, drive, tmp_path):
    items = sweep_items([drive], [], 20, ["slip"])

    def closing(done, total):  # noqa: ARG001
        if done == 2:
            cluster.close()

    with open_store(tmp_path / "out") as folder:
        with pytest.raises(InputError, match=r"--scheduler: tcp.*the cluster was lost"):
            run_sweep(items, folder, closing, scheduler=cluster.scheduler_address)
        assert len(kept(folder)) >= 2


def test_a_killed_command_is_gone_on_with(cluster, drive, tmp_path):
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-c",
        "from runs.cli import main; main()",
        "sweep",
        str(drive),
        "--seeds",
        "20",
    ]
    command += ["--faults", "slip", "--out", str(out), "--scheduler", cluster.scheduler_address]
    first = subprocess.Popen(command)
    end = time.monotonic() + 60.0
    while len(kept(out)) < 3 and time.monotonic() < end:
        time.sleep(0.02)
    first.kill()
    first.wait()
    before = kept(out)
    assert 3 <= len(before) < 20
    assert not (out / "results.parquet").exists()
    subprocess.run(command, check=True, capture_output=True)
    after = kept(out)
    assert len(after) == 20
    assert before.items() <= after.items(), "what was done is not done again"
    assert (out / "results.parquet").exists()
