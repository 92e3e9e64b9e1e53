"""How often frames are matched: a rate that skips the frames between."""

from __future__ import annotations


class Pace:
    """Tells which frames are due, and counts those that are not."""

    def __init__(self, rate_hz: float | None) -> None:
        """Let through at most so many frames a second of capture time; None lets all through."""
        self._period_ns = None if rate_hz is None else 1e9 / rate_hz
        self._due_ns: float | None = None
        self.dropped = 0

    def due(self, stamp_ns: int) -> bool:
        """Tell whether a frame of this stamp is to be matched; stamps may come out of order.

        A late frame does not make the next one due later: the rate is kept on average.
        """
        if self._period_ns is None:
            return True
        if self._due_ns is not None and stamp_ns < self._due_ns:
            self.dropped += 1
            return False
        since_ns = 0.0 if self._due_ns is None else stamp_ns - self._due_ns
        self._due_ns = stamp_ns + self._period_ns - min(since_ns, 0.5 * self._period_ns)
        return True
