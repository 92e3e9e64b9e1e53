"""A sweep's folder: a file an item, put there whole when it is done, so that a sweep that was killed goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from maps.errors import InputError, MissingExtraError
from maps.mapdocument import write_whole
from runs.experiments.trials import trials_made
from runs.folderlock import sole_writer
from runs.sweep import Item, Row, Sweep
from runs.sweepmark import Marks

#: Called with how many items are done, and of how many.
Progress = Callable[[int, int], None]

_ITEMS = "items"


@contextmanager
def open_store(folder: Path) -> Iterator[Path]:
    """Hold a sweep's folder for this process alone; InputError where another has it, or it is something else."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "", "is there already, and is not a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / _ITEMS).is_dir():
        raise InputError(folder, "", "is there already, and is not a sweep's")
    with sole_writer(folder):
        (folder / _ITEMS).mkdir(exist_ok=True)
        yield folder


def run_sweep(
    items: Sequence[Item], folder: Path, progress: Progress, workers: int = 1, scheduler: str | None = None
) -> list[Row]:
    """Run the items that `folder` has no result of, and return the rows of all, in order.

    An item that failed is tried again. InputError where no scheduler answers.
    """
    places = [_place(folder, number, item) for number, item in enumerate(items)]
    known = Marks()
    marks = [_mark(known, item) for item in items]
    rows = {number: row for number, place in enumerate(places) if (row := _kept(place, marks[number]))}
    pending = [number for number in range(len(items)) if number not in rows]
    progress(len(rows), len(items))
    if pending:
        sweep = Sweep(tuple(items[number] for number in pending))
        # More processes than items only cost memory.
        for at, row in trials_made(sweep, len(pending), min(workers, len(pending)), scheduler):
            number = pending[at]
            content = {"fingerprint": marks[number], "row": row}
            write_whole(places[number], json.dumps(content, indent=1).encode())
            rows[number] = row
            progress(len(rows), len(items))
    return [rows[number] for number in range(len(items))]


def write_results(folder: Path, rows: Sequence[Row]) -> Path:
    """Write results.parquet, a row an item, whole or not at all; return its path.

    MissingExtraError without pyarrow.
    """
    pyarrow, parquet = arrow()
    path = folder / "results.parquet"
    columns = list(dict.fromkeys(name for row in rows for name in row))
    table = pyarrow.table({name: pyarrow.array([row.get(name) for row in rows]) for name in columns})
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(table, sink)
    write_whole(path, sink.getvalue().to_pybytes())
    return path


def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its Parquet part; MissingExtraError where it is not installed."""
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise MissingExtraError("sweep needs the study extra: pip install 'wireloc[study]'") from None


def _place(folder: Path, number: int, item: Item) -> Path:
    names = "-".join(str(value) for value in item.names.values())
    return folder / _ITEMS / f"{number:05d}-{names}.json"


def _mark(known: Marks, item: Item) -> str:
    try:
        return known.of(item)
    except OSError:
        # It will fail when it is run, and be told in its row.
        return ""


def _kept(place: Path, mark: str) -> Row | None:
    """Return an item's row from before, None where there is none, it failed, or its files have changed."""
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
        row: Row = content["row"]
        kept = bool(mark) and content["fingerprint"] == mark and row["status"] != "failed"
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return row if kept else None
