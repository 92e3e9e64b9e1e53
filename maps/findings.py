"""What a look over a map found: each finding says how bad, what, where, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """An error must be mended before the map is used; a warning may be meant; a note is for information."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


class Fault(StrEnum):
    """What can be wrong with a map."""

    REFUSED = "refused"
    UNITS = "implausible units"
    TOO_SHORT = "too short"
    DOUBLED = "doubled"
    OVERLAPPING = "overlapping"
    OUTSIDE = "outside the building"
    FLOATING = "floating"
    BELOW_FLOOR = "below the floor"
    ABOVE_CEILING = "above the ceiling"
    SAME_NAME = "same name"
    FLOOR_SHAPE = "floor shape"
    UNREACHABLE = "unreachable"
    LINTEL = "lintel"
    NO_VERTICAL = "no vertical edge"
    LOOK_ALIKE = "look-alike"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing wrong with a map.

    `where`: names of the segments, lintels or rooms concerned, or a key of the file such as `floor[0]`.
    `what`: the fault in figures. `advice`: what to do about it.
    """

    severity: Severity
    fault: Fault
    where: tuple[str, ...]
    what: str
    advice: str
