"""The CSV tables of a session, read with checks that name file, line and column."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maps.documents import read_text
from maps.errors import InputError
from maps.poses import Array

Times = NDArray[np.int64]

#: Seconds that fit in 64 bits of nanoseconds, with room for a difference; epoch times do.
MAX_TIME_S = 4e9
#: Beyond any coordinate, angle or speed of a robot; keeps sums and squares finite.
MAX_NUMBER = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """The rows of a CSV file as text: `header` the column names, `lines` each row's line in the file."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def has(self, *names: str) -> bool:
        """Whether the header has all these columns."""
        return set(names) <= set(self.header)

    def texts(self, name: str) -> list[str]:
        """Return a column as stripped text; InputError where there is no such column."""
        if name not in self.header:
            raise InputError(self.path, "line 1", f"no column {name}")
        column = self.header.index(name)
        return [row[column] for row in self.rows]

    def numbers(self, name: str, may_be_empty: bool = False) -> Array:
        """Return a column of finite numbers, (N,); an empty cell is NaN where that is allowed."""
        values = np.empty(len(self))
        for row, text in enumerate(self.texts(name)):
            with self.naming(row, name):
                values[row] = math.nan if may_be_empty and not text else _number(text, MAX_NUMBER)
        return values

    def times(self, name: str = "timestamp_s", may_repeat: bool = False) -> Times:
        """Return a column of seconds as integer nanoseconds, (N,), which never run backwards."""
        times = self._nanoseconds(name)
        steps = np.diff(times)
        wrong = np.flatnonzero(steps < 0 if may_repeat else steps <= 0)
        if len(wrong):
            how = "repeats" if steps[wrong[0]] == 0 else "runs backwards"
            raise InputError(self.path, f"line {self.lines[wrong[0] + 1]}", f"{name} {how}")
        return times

    def arrivals(self, stamps_ns: Times) -> Times:
        """Return when each row reached the computer, (N,): arrival_s, or at its stamp without one."""
        if not self.has("arrival_s"):
            return stamps_ns
        arrivals = self._nanoseconds("arrival_s")
        early = np.flatnonzero(arrivals < stamps_ns)
        if len(early):
            raise InputError(self.path, f"line {self.lines[early[0]]}", "arrival_s is before timestamp_s")
        return arrivals

    @contextmanager
    def naming(self, row: int, name: str) -> Iterator[None]:
        """Turn a ValueError about a cell into an InputError that names its line and column."""
        try:
            yield
        except ValueError as error:
            raise InputError(self.path, f"line {self.lines[row]}", f"{name}: {error}") from None

    def _nanoseconds(self, name: str) -> Times:
        times = np.empty(len(self), np.int64)
        for row, text in enumerate(self.texts(name)):
            with self.naming(row, name):
                _number(text, MAX_TIME_S)
                times[row] = int(Decimal(text).scaleb(9).to_integral_value())
        return times


def read_table(path: Path) -> Table:
    """Read a CSV file with a header and at least one row, every row as wide as the header.

    InputError names the line; blank lines are skipped.
    """
    reader = csv.reader(read_text(path).splitlines(), strict=True)
    header: tuple[str, ...] = ()
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            row = tuple(cell.strip() for cell in cells)
            if not any(row):
                continue
            if not header:
                header = row
            elif len(row) != len(header):
                what = f"{len(row)} cells under a header of {len(header)}"
                raise InputError(path, f"line {reader.line_num}", what)
            else:
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(path, f"line {reader.line_num}", f"not CSV: {error}") from None
    if len(set(header)) < len(header):
        raise InputError(path, "line 1", "a column name is there twice")
    if not rows:
        raise InputError(path, "", "no rows")
    return Table(path, header, tuple(rows), tuple(lines))


def _number(text: str, limit: float) -> float:
    try:
        value = float(Decimal(text))
    except InvalidOperation:
        raise ValueError(f"{text!r} is not a number" if text else "empty") from None
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite")
    if abs(value) > limit:
        raise ValueError(f"{text} is out of range")
    return value
