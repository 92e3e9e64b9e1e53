"""Many independent trials: in this process, on all its machine's cores, or on a Dask cluster.

Each trial knows its number and draws from a seed of its own, so the results are the same wherever and in
whatever order they are made.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar

from maps.errors import InputError, MissingExtraError

#: Called after every trial with how many are done, and of how many.
Progress = Callable[[int, int], None]
T = TypeVar("T")

_HINT = "needs the study extra: pip install 'wireloc[study]'"
#: A cluster that does not answer within this is not there.
_CONNECT_S = 10


def run_trials(
    trial: Callable[[int], T],
    count: int,
    progress: Progress,
    workers: int = 1,
    scheduler: str | None = None,
) -> list[T]:
    """Return trial(0) ... trial(count - 1), in this order.

    `trial` must be picklable for more than one worker, or for `scheduler`, the address of a Dask cluster.
    MissingExtraError without the libraries, InputError where no scheduler answers, or workers are lost.
    """
    results: dict[int, T] = {}
    progress(0, count)
    for number, result in trials_made(trial, count, workers, scheduler):
        results[number] = result
        progress(len(results), count)
    return [results[number] for number in range(count)]


def trials_made(
    trial: Callable[[int], T], count: int, workers: int = 1, scheduler: str | None = None
) -> Iterator[tuple[int, T]]:
    """Yield number and result of each trial as it is made, in any order; else as `run_trials`."""
    if scheduler is not None:
        return _on_cluster(trial, count, scheduler)
    if workers > 1:
        return _on_cores(trial, count, workers)
    return (_numbered(trial, number) for number in range(count))


def _on_cores(trial: Callable[[int], T], count: int, workers: int) -> Iterator[tuple[int, T]]:
    try:
        from joblib import Parallel, delayed
    except ModuleNotFoundError:
        raise MissingExtraError(f"--workers {workers} {_HINT}") from None
    pool = Parallel(n_jobs=workers, return_as="generator_unordered")
    try:
        yield from pool(delayed(_numbered)(trial, number) for number in range(count))
    except BrokenExecutor:
        what = "a process was ended from outside, most often for want of memory: try fewer"
        raise InputError("--workers", str(workers), what) from None


def _on_cluster(trial: Callable[[int], T], count: int, scheduler: str) -> Iterator[tuple[int, T]]:
    try:
        distributed: Any = import_module("distributed")
    except ModuleNotFoundError:
        raise MissingExtraError(f"--scheduler {_HINT}") from None
    try:
        client = distributed.Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise InputError("--scheduler", scheduler, f"no cluster answers there ({error})") from None
    with _silent("distributed"), client:
        # Sent once: the map and its regions are in it. A task, that a worker's end does not lose it.
        sent = client.submit(_itself, trial, pure=False)
        futures = [client.submit(_numbered, sent, number, pure=False) for number in range(count)]
        try:
            for future in distributed.as_completed(futures):
                yield future.result()
        except (CancelledError, distributed.KilledWorker, distributed.comm.CommClosedError) as error:
            raise InputError("--scheduler", scheduler, f"the cluster was lost ({error})") from None


@contextmanager
def _silent(library: str) -> Iterator[None]:
    """Keep a library from logging what is told here in one line."""
    logger = logging.getLogger(library)
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


def _itself(trial: T) -> T:
    return trial


def _numbered(trial: Callable[[int], T], number: int) -> tuple[int, T]:
    return number, trial(number)
