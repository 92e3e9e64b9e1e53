"""What goes wrong with odometry: rows lost, wheels that slip or are blocked, encoders that jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maps.poses import Array, frozen
from runs.faults.recording import Recording, Span
from runs.session import Odometry
from runs.simulation.wheels import BASELINE_M

SLIP_M = 0.5
#: What an encoder counts too much, at once.
JUMP_RAD = 10.0
#: What a twist reads for one row in its place.
JUMP_MPS, JUMP_RADPS = 10.0, 20.0


def dropout(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Lose odometry's rows; encoders catch up after it, twists do not."""
    odometry = recording.session.odometry
    kept = ~span.holds(odometry.stamps_ns)
    # The file needs a beginning and an end.
    kept[[0, -1]] = True
    return _with(
        recording,
        replace(
            odometry,
            stamps_ns=odometry.stamps_ns[kept],
            arrivals_ns=odometry.arrivals_ns[kept],
            values=odometry.values[kept],
        ),
    )


def slip(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Let both wheels roll half a metre more than the robot drives, evenly over the span."""
    odometry = recording.session.odometry
    seconds = (span.end_ns - span.start_ns) / 1e9
    if odometry.wheels is None:
        return _with(recording, _sped(odometry, span, SLIP_M / seconds))
    share = np.clip((odometry.stamps_ns - span.start_ns) / (span.end_ns - span.start_ns), 0.0, 1.0)
    radii_m = np.array([odometry.wheels.left_radius_m, odometry.wheels.right_radius_m])
    return _with(
        recording, replace(odometry, values=frozen(odometry.values + SLIP_M * share[:, None] / radii_m))
    )


def blocked(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let one wheel drag over the floor without turning, while the robot drives on as it did."""
    odometry, side = recording.session.odometry, blocked_side(rng)
    inside = span.holds(odometry.stamps_ns)
    values = odometry.values.copy()
    if odometry.wheels is None:
        # The other wheel rolls on: half of its speed is the robot's, and all of it turns.
        towards = -1.0 if side else 1.0
        speed_mps = values[inside, 0] + towards * 0.5 * BASELINE_M * values[inside, 1]
        values[inside] = np.column_stack([0.5 * speed_mps, towards * speed_mps / BASELINE_M])
        return _with(recording, replace(odometry, values=frozen(values)))
    rolled = np.diff(values[:, side], prepend=values[0, side])
    rolled[inside] = 0.0
    values[:, side] = values[0, side] + np.cumsum(rolled)
    return _with(recording, replace(odometry, values=frozen(values)))


def blocked_side(rng: np.random.Generator) -> int:
    """Draw which wheel is blocked: 0 the left one, 1 the right one."""
    return int(rng.integers(2))


def jump(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:
    """Let one encoder jump, from one row to the next, or one row of twists read nonsense."""
    odometry, side = recording.session.odometry, int(rng.integers(2))
    row = min(int(np.searchsorted(odometry.stamps_ns, span.start_ns)), len(odometry.stamps_ns) - 1)
    values = odometry.values.copy()
    if odometry.wheels is None:
        values[row] = JUMP_MPS, JUMP_RADPS
    else:
        values[row:, side] += JUMP_RAD
    return _with(recording, replace(odometry, values=frozen(values)))


def busiest(odometry: Odometry, seconds: float, start_ns: int, end_ns: int) -> int:
    """Return when, between two stamps, that many seconds with the most motion begin."""
    stamps_ns = odometry.stamps_ns
    rolled = np.concatenate([[0.0], np.cumsum(_activity(odometry))])
    ends = np.searchsorted(stamps_ns, stamps_ns + round(seconds * 1e9))
    inside = (stamps_ns >= start_ns) & (stamps_ns < end_ns) & (ends < len(stamps_ns))
    if not inside.any():
        return start_ns
    gained = np.where(inside, rolled[np.minimum(ends, len(rolled) - 1)] - rolled[: len(stamps_ns)], -1.0)
    return int(stamps_ns[int(np.argmax(gained))])


def _activity(odometry: Odometry) -> Array:
    """Return how much each row's step moves, (N - 1,)."""
    if odometry.wheels is None:
        result: Array = np.abs(odometry.values[:-1, 0]) * np.diff(odometry.stamps_ns) / 1e9
    else:
        result = np.abs(np.diff(odometry.values, axis=0)).min(axis=1)
    return result


def _sped(odometry: Odometry, span: Span, forward_mps: float) -> Odometry:
    values = odometry.values.copy()
    values[span.holds(odometry.stamps_ns), 0] += forward_mps
    return replace(odometry, values=frozen(values))


def _with(recording: Recording, odometry: Odometry) -> Recording:
    return replace(recording, session=replace(recording.session, odometry=odometry))
