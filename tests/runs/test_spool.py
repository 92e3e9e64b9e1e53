"""Sequences on disk: what comes back is what went in, to the last bit, and it does not stay in memory."""

import dataclasses
import gc
import math
import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from localization.odometry import OdometryNoise, WheelGeometry, wheel_step
from localization.states import State
from maps.outcomes import Fix, Look, PoseBelief
from maps.poses import Pose2
from runs.diary import BELIEF, MILLISECONDS, SPAN, STEP, StateSpan
from runs.spool import BLOCK, Rows, Shelf


def belief(number):
    covariance = np.diag([1e-4 * (number + 1), 1e-4, math.inf if number % 3 == 2 else 1e-5])
    return PoseBelief(number * 20_000_000, Pose2(0.1 * number, -1 / 3, 2.0 * number), covariance)


def step(number):
    wheels, noise = WheelGeometry(0.05, 0.0501, 0.3), OdometryNoise()
    return wheel_step(number * 10**7, (number + 1) * 10**7, 0.1 * number, 0.2, wheels, noise)


def plain(value):
    """Return a value's fields as what compares bit by bit."""
    if dataclasses.is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in dataclasses.fields(value)]
    return value.tobytes() if isinstance(value, np.ndarray) else value


MADE = {
    "beliefs": (BELIEF, belief),
    "steps": (STEP, step),
    "spans": (SPAN, lambda number: StateSpan(number, number + 5, list(State)[number % len(State)])),
    "milliseconds": (MILLISECONDS, lambda number: math.sqrt(number)),
}


@pytest.mark.parametrize("name", MADE)
@pytest.mark.parametrize("count", [1, BLOCK, 2 * BLOCK + 7])
def test_rows_come_back_as_they_were(name, count):
    layout, made = MADE[name]
    rows, values = Rows(layout), [made(number) for number in range(count)]
    rows.extend(values)
    assert len(rows) == len(rows.table()) == count
    assert [plain(value) for value in rows] == [plain(value) for value in values]
    assert plain(rows[-1]) == plain(values[-1])
    assert [plain(value) for value in rows[1:5]] == [plain(value) for value in values[1:5]]
    rows.append(made(count))
    assert plain(rows[count]) == plain(made(count))
    with pytest.raises(IndexError):
        rows[count + 1]


def test_a_table_is_read_only_and_outlives_its_rows():
    rows = Rows(BELIEF)
    rows.extend(map(belief, range(3)))
    table = rows.table()
    with pytest.raises(ValueError, match="read-only"):
        table["stamp_ns"][0] = 1
    del rows
    assert table["stamp_ns"].tolist() == [0, 20_000_000, 40_000_000]


def test_no_rows():
    rows = Rows(BELIEF)
    assert (len(rows), list(rows), rows[:3], len(rows.table())) == (0, [], (), 0)


def test_a_shelf_takes_values_of_any_size():
    outcomes = [Fix(belief(number), Look(lines_px=np.ones((number, 2, 2)))) for number in range(20)]
    shelf = Shelf()
    for number, outcome in enumerate(outcomes):
        shelf.append(outcome)
        assert len(shelf[number // 2].look.lines_px) == number // 2, "reading between must not harm"
    assert len(shelf) == 20
    assert [plain(value) for value in shelf] == [plain(value) for value in outcomes]
    assert plain(shelf[-1]) == plain(outcomes[-1])
    assert [len(value.look.lines_px) for value in shelf[2:5]] == [2, 3, 4]
    with pytest.raises(IndexError):
        shelf[20]


def test_rows_and_shelves_take_no_memory():
    rows, shelf, look = Rows(BELIEF), Shelf(), Look(lines_px=np.ones((200, 2, 2)))
    rows.extend(map(belief, range(BLOCK)))
    gc.collect()
    tracemalloc.start()
    try:
        rows.extend(map(belief, range(3 * BLOCK)))
        for number in range(300):
            shelf.append(Fix(belief(number), look))
        gc.collect()
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert taken < 200_000, "as lists, 1.9 MB and more"


def test_files_have_no_names_and_go_with_their_owners(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").exists() else 0
    rows, shelf = Rows(BELIEF), Shelf()
    rows.extend(map(belief, range(BLOCK)))
    shelf.append(1)
    assert list(tmp_path.iterdir()) == []
    del rows, shelf
    gc.collect()
    if before:
        assert len(os.listdir("/proc/self/fd")) <= before
