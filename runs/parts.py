"""A long drive in parts: smoothed one after the other, hours take no more memory than one of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt


@dataclass(frozen=True, slots=True)
class PartsConfig:
    """How a drive is cut into parts.

    `length_s`: of a part, at most; what is shorter is smoothed as a whole. Smoothing takes 0.4 GB for so long.
    `overlap_s`: what a part knows of the next one, and looks back into the one before. A fix tells little of
    where the robot was a minute ago, with others in between.
    """

    length_s: Annotated[float, Gt(0.0)] = 900.0
    overlap_s: Annotated[float, Ge(0.0)] = 60.0


@dataclass(frozen=True, slots=True)
class Part:
    """A part tells of what lies from `begin_ns` to before `end_ns`; None where the drive begins or ends.

    `from_ns`, `until_ns`: what it is worked out from.
    """

    begin_ns: int | None
    end_ns: int | None
    from_ns: int | None
    until_ns: int | None

    def tells_of(self, stamp_ns: int) -> bool:
        """Whether a stamp lies inside."""
        return not (
            (self.begin_ns is not None and stamp_ns < self.begin_ns)
            or (self.end_ns is not None and stamp_ns >= self.end_ns)
        )


def parts_of(start_ns: int, end_ns: int, config: PartsConfig) -> list[Part]:
    """Return the parts of a drive, all of one length."""
    count = max(math.ceil((end_ns - start_ns) / (config.length_s * 1e9)), 1)
    overlap_ns = round(config.overlap_s * 1e9)
    cuts = [start_ns + (end_ns - start_ns) * number // count for number in range(1, count)]
    return [
        Part(
            begin,
            end,
            None if begin is None else begin - overlap_ns,
            None if end is None else end + overlap_ns,
        )
        for begin, end in zip([None, *cuts], [*cuts, None], strict=True)
    ]
