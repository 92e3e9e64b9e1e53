"""Sequences that lie on disk: a run of hours writes down more than its memory should hold.

Both are appended to and read back, bit for bit; their files have no name and go when they do.
"""

from __future__ import annotations

import pickle
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import SEEK_END
from tempfile import TemporaryFile
from typing import IO, Any, Generic, TypeVar, overload
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

#: Rows that wait in memory to be written together; one by one they would cost three times as much.
BLOCK = 500

#: Of pickling. Later ones look into arrays as buffers, and numpy remembers that for as long as an array lives.
PROTOCOL = 4


@dataclass(frozen=True, slots=True, eq=False)
class Layout(Generic[T]):
    """How a value becomes a row of fixed size, and a row a value again."""

    dtype: np.dtype[np.void]
    row: Callable[[T], tuple[Any, ...]]
    value: Callable[[Any], T]


class Rows(Sequence[T]):
    """Values of one kind, a row of fixed size each: for what comes with every odometry step."""

    def __init__(self, layout: Layout[T]) -> None:
        """Begin with none."""
        self._layout, self._waiting = layout, list[tuple[Any, ...]]()
        self._file: IO[bytes] | None = None
        self._written = 0
        self._table: NDArray[np.void] = np.empty(0, layout.dtype)

    def append(self, value: T) -> None:
        """Write a value after the others."""
        self._waiting.append(self._layout.row(value))
        if len(self._waiting) >= BLOCK:
            self._write()

    def extend(self, values: Iterable[T]) -> None:
        """Write values after the others."""
        for value in values:
            self.append(value)

    def table(self) -> NDArray[np.void]:
        """Return all rows, (N,), one field a column; mapped from the file, so it costs no memory."""
        self._write()
        if self._file is not None and len(self._table) < self._written:
            self._table = np.asarray(np.memmap(self._file, self._layout.dtype, "r", shape=(self._written,)))
        return self._table

    def __len__(self) -> int:
        """Tell how many there are."""
        return self._written + len(self._waiting)

    def __iter__(self) -> Iterator[T]:
        """Read one after the other."""
        return map(self._layout.value, self.table())

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[T, ...]: ...
    def __getitem__(self, index: int | slice) -> T | tuple[T, ...]:
        """Read one, or several."""
        value, found = self._layout.value, self.table()[index]
        return tuple(map(value, found)) if isinstance(index, slice) else value(found)

    def _write(self) -> None:
        if not self._waiting:
            return
        if self._file is None:
            self._file = _nameless(self)
        self._file.write(np.array(self._waiting, self._layout.dtype).tobytes())
        self._file.flush()
        self._written += len(self._waiting)
        self._waiting.clear()


class Shelf(Sequence[T]):
    """Values of any size, pickled one by one: for what comes with every look."""

    def __init__(self) -> None:
        """Begin with none."""
        self._file = _nameless(self)
        self._ends = array("q", [0])

    def append(self, value: T) -> None:
        """Write a value after the others."""
        self._file.seek(0, SEEK_END)
        self._file.write(pickle.dumps(value, PROTOCOL))
        self._ends.append(self._file.tell())

    def __len__(self) -> int:
        """Tell how many there are."""
        return len(self._ends) - 1

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[T, ...]: ...
    def __getitem__(self, index: int | slice) -> T | tuple[T, ...]:
        """Read one, or several."""
        which = range(len(self))[index]
        return self._read(which) if isinstance(which, int) else tuple(map(self._read, which))

    def _read(self, number: int) -> T:
        begin, end = self._ends[number], self._ends[number + 1]
        self._file.seek(begin)
        value: T = pickle.loads(self._file.read(end - begin))
        return value


def _nameless(owner: object) -> IO[bytes]:
    """Open a file without a name, which is closed, and gone, with its owner."""
    file = TemporaryFile()  # noqa: SIM115 - it is closed with its owner
    finalize(owner, file.close)
    return file
