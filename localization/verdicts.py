"""What became of a look at the world: the verdicts of localization, counted by the evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from maps.outcomes import Reason


class Refusal(StrEnum):
    """Why a fix was not fused."""

    GATE = "GATE"
    TOO_OLD = "TOO_OLD"
    TOO_NEW = "TOO_NEW"


class Unused(StrEnum):
    """Why a look that found something could not be fused.

    UNCONFIRMED: while lost; the place counts once other looks confirm it.
    """

    AMBIGUOUS = "AMBIGUOUS"
    HEADING_UNKNOWN = "HEADING_UNKNOWN"
    UNCONFIRMED = "UNCONFIRMED"


@dataclass(frozen=True, slots=True)
class Fused:
    """The fix went into the belief; `nis`: its normalized innovation squared."""

    nis: float


@dataclass(frozen=True, slots=True)
class Rejected:
    """The fix was refused; `nis`, its squared distance, where it was compared with the belief."""

    reason: Refusal
    nis: float | None = None


@dataclass(frozen=True, slots=True)
class Missed:
    """There was no fix to fuse."""

    reason: Reason | Unused


@dataclass(frozen=True, slots=True)
class Relocalized:
    """Looks that agree with each other and with odometry won over what was believed, or over nothing.

    `nis`: of this one among them.
    """

    nis: float


#: The verdicts by which a fix went into the belief.
ACCEPTED = (Fused, Relocalized)

Verdict = Fused | Rejected | Missed | Relocalized
