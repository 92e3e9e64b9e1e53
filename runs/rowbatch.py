"""What looks leave in a recording, gathered and sent together: a look alone would cost a millisecond an entity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
import rerun as rr

#: Values of one component of one row; all components of a row have as many.
Values = Sequence[Any] | np.ndarray[Any, Any]


@dataclass(slots=True)
class _Rows:
    archetype: Any
    stamps_ns: list[int] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    values: dict[str, list[Values]] = field(default_factory=dict)


class RowBatch:
    """Rows for any number of entities, each a look's; `look` says whose, `send` sends them all."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._rows: dict[str, _Rows] = {}
        self._stamp_ns = self._number = 0

    def look(self, stamp_ns: int, number: int) -> None:
        """Say which look what is added from now on belongs to."""
        self._stamp_ns, self._number = stamp_ns, number

    def add(self, entity: str, archetype: Any, **values: Values) -> None:
        """Add one row of an archetype's components; empty ones show nothing from this look on."""
        rows = self._rows.setdefault(entity, _Rows(archetype))
        rows.stamps_ns.append(self._stamp_ns)
        rows.numbers.append(self._number)
        rows.lengths.append(len(next(iter(values.values()))))
        for name, column in values.items():
            rows.values.setdefault(name, []).append(column)

    def send(self) -> None:
        """Send the rows gathered since the last time."""
        for entity, rows in self._rows.items():
            times = (
                rr.TimeColumn("sim_time", duration=np.array(rows.stamps_ns, "timedelta64[ns]")),
                rr.TimeColumn("frame", sequence=rows.numbers),
            )
            joined = {name: _joined(values) for name, values in rows.values.items()}
            columns = rows.archetype.columns(**joined).partition(lengths=rows.lengths)
            self._recording.send_columns(entity, times, columns)
        self._rows = {}


def _joined(values: list[Values]) -> Values:
    """Put the rows' values one after the other."""
    arrays = [value for value in values if isinstance(value, np.ndarray)]
    if len(arrays) == len(values):
        return np.concatenate(arrays)
    return list(chain.from_iterable(values))
