"""How much of a run is recorded."""

from __future__ import annotations

from enum import StrEnum


class LogDetail(StrEnum):
    """How much of a run is recorded.

    FULL: everything. FIXES: no pictures and no lines, which are most of a recording. OFF: no recording.
    """

    FULL = "full"
    FIXES = "fixes"
    OFF = "off"
