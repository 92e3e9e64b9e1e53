"""What goes wrong on the way from the camera: frames lost, repeated, late, or stamped by a clock that is off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maps.outcomes import Fix
from runs.faults.recording import Recording, Span
from runs.session import Frame, RecordedFix

#: Of the frames in the span.
DROPPED_SHARE, DOUBLED_SHARE = 0.5, 0.33
#: Longer than most robots' frames are apart, so that some overtake others.
LATE_S = 3.0
OFFSET_S = 0.1
#: A clock that gains a second in a quarter of an hour: worse than any quartz.
DRIFT = 1e-3


def dropped(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Lose half of the frames and fixes."""
    session = recording.session
    lost = rng.random(len(session.frames) + len(session.fixes)) < DROPPED_SHARE
    frames = [
        pair
        for number, pair in enumerate(zip(session.frames, recording.edits, strict=True))
        if number == 0 or not (lost[number] and span.holds(pair[0].stamp_ns))
    ]
    fixes = [
        fix
        for fix, gone in zip(session.fixes, lost[len(session.frames) :], strict=True)
        if fix is session.fixes[0] or not (gone and span.holds(fix.stamp_ns))
    ]
    return recording.with_looks(frames, fixes)


def doubled(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Show the picture before once more, at the stamp of a frame that is lost; fixes likewise."""
    session = recording.session
    pairs = list(zip(session.frames, recording.edits, strict=True))
    for number in range(1, len(pairs)):
        frame, before = pairs[number][0], pairs[number - 1]
        if rng.random() < DOUBLED_SHARE and span.holds(frame.stamp_ns):
            pairs[number] = _showing(frame, before[0]), before[1]
    fixes = list(session.fixes)
    for number in range(1, len(fixes)):
        if rng.random() < DOUBLED_SHARE and span.holds(fixes[number].stamp_ns):
            belief = replace(fixes[number - 1].fix.belief, stamp_ns=fixes[number].stamp_ns)
            fixes[number] = replace(fixes[number], fix=Fix(belief))
    return recording.with_looks(pairs, fixes)


def _showing(frame: Frame, other: Frame) -> Frame:
    """Return the frame with another one's picture."""
    return replace(frame, filename=other.filename, path=other.path, picture=other.picture)


def late(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let frames and fixes arrive up to three seconds late, each by its own delay: some overtake others."""

    def delayed(stamp_ns: int) -> int:
        return round(rng.uniform(0.0, LATE_S) * 1e9) if span.holds(stamp_ns) else 0

    return _retimed(recording, lambda stamp_ns: stamp_ns, delayed)


def clock_offset(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let the camera's clock be off by a tenth of a second, one way or the other."""
    shift_ns = round(float(rng.choice([-1.0, 1.0])) * OFFSET_S * 1e9)
    return _retimed(recording, lambda stamp_ns: stamp_ns + shift_ns * int(span.holds(stamp_ns)))


def clock_drift(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let the camera's clock gain or lose a thousandth; what it has gained by the span's end, it keeps."""
    rate = float(rng.choice([-1.0, 1.0])) * DRIFT

    def drifted(stamp_ns: int) -> int:
        since = min(max(stamp_ns - span.start_ns, 0), span.end_ns - span.start_ns)
        return stamp_ns + round(rate * since)

    return _retimed(recording, drifted)


def _retimed(
    recording: Recording, stamp_of: Callable[[int], int], delay_of: Callable[[int], int] = lambda _: 0
) -> Recording:
    """Return it with other stamps, in order, and arrivals that keep their distance from them, and a delay more."""
    session = recording.session
    frames = []
    for frame, edit in zip(session.frames, recording.edits, strict=True):
        stamp_ns, arrival_ns = _times(frame, stamp_of, delay_of)
        frames.append((replace(frame, stamp_ns=stamp_ns, arrival_ns=arrival_ns), edit))
    fixes = []
    for fix in session.fixes:
        stamp_ns, arrival_ns = _times(fix, stamp_of, delay_of)
        belief = replace(fix.fix.belief, stamp_ns=stamp_ns)
        fixes.append(RecordedFix(stamp_ns, arrival_ns, Fix(belief)))
    # A clock that is set back may show a time twice; the stamps of a file never run backwards.
    kept = [
        pair for at, pair in enumerate(frames) if at == 0 or pair[0].stamp_ns > frames[at - 1][0].stamp_ns
    ]
    return recording.with_looks(kept, sorted(fixes, key=lambda fix: fix.stamp_ns))


def _times(
    look: Frame | RecordedFix, stamp_of: Callable[[int], int], delay_of: Callable[[int], int]
) -> tuple[int, int]:
    stamp_ns = stamp_of(look.stamp_ns)
    return stamp_ns, stamp_ns + look.arrival_ns - look.stamp_ns + delay_of(look.stamp_ns)
