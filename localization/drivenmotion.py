"""Odometry as a function of the robot's own parameters: the motion between any stamps, its slopes and its noise.

For estimating the parameters. Slopes are taken by a complex step (Squire and Trapp, SIAM Review 1998): the
same lines of code run once with a parameter moved by a tiny imaginary amount, which gives the derivative to
the last digit. So nothing here may take absolute values, or compare, but of real parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from localization.odometry import OdometryNoise
from maps.poses import Array

#: What is estimated of encoders: radii and baseline [m]; of twists: factors, and an addition [rad/s].
WHEEL_PARAMETERS = ("left_radius_m", "right_radius_m", "baseline_m", "time_offset_s")
TWIST_PARAMETERS = ("forward_scale", "turn_scale", "turn_bias_radps", "time_offset_s")
_STEP = 1e-30

#: Numbers, or numbers moved by an imaginary step.
Numbers = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class OdometryRecord:
    """What odometry recorded: `stamps_s` (N,) rising, [s]; `values` (N, 2).

    Cumulative wheel angles, left and right [rad], where `by_wheels`, else twists that hold until the next row,
    forward [m/s] and turn [rad/s].
    """

    stamps_s: Array
    values: Array
    by_wheels: bool

    @property
    def names(self) -> tuple[str, ...]:
        """What the parameters (4,) are."""
        return WHEEL_PARAMETERS if self.by_wheels else TWIST_PARAMETERS

    @property
    def cumulative(self) -> Array:
        """Wheel angles, or forward [m] and turn [rad] since the first row, (N, 2)."""
        if self.by_wheels:
            return self.values
        lasting = np.diff(self.stamps_s)[:, None]
        summed: Array = np.concatenate([np.zeros((1, 2)), np.cumsum(self.values[:-1] * lasting, axis=0)])
        return summed


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """The motions between F stamps, each seen from the pose before it.

    `poses`: (F - 1, 3) x, y [m], phi [rad], not wrapped. `slopes`: (F - 1, 3, 4) by the record's parameters.
    `covariances`: (F - 1, 3, 3) of random errors.
    """

    poses: Array
    slopes: Array
    covariances: Array


def motions_between(
    record: OdometryRecord, parameters: Array, stamps_s: Array, noise: OdometryNoise
) -> Motions:
    """Return the motions between stamps (F,) of another clock, F >= 2, rising.

    `parameters`: (4,) as `record.names` says; the last, the time offset, added to a stamp gives odometry's clock.
    Beyond odometry's rows the robot stands.
    """
    poses, steps = _reckoned(record, parameters, stamps_s)
    slopes = np.empty((len(stamps_s) - 1, 3, len(parameters)))
    for index in range(len(parameters)):
        moved = parameters.astype(np.complex128)
        moved[index] += 1j * _STEP
        slopes[:, :, index] = _reckoned(record, moved, stamps_s)[0].imag / _STEP
    return Motions(poses.real, slopes, _covariances(record, steps, parameters, noise))


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """The arcs between knots, which are odometry's rows and the stamps asked for.

    `first`: (F,) the knots that are stamps. `motion`: (K, 2) forward and turn, `middle`: (K,) the heading halfway.
    `places`: (K + 1, 3) dead reckoning at the knots. `seconds`: (K,).
    """

    first: NDArray[np.intp]
    motion: Numbers
    middle: Numbers
    places: Numbers
    seconds: Array


def _reckoned(record: OdometryRecord, parameters: Numbers, stamps_s: Array) -> tuple[Numbers, _Steps]:
    """Dead-reckon through all rows and stamps; the motions between the stamps (F - 1, 3), and the steps."""
    at = stamps_s + parameters[3]
    values = record.cumulative
    row = np.clip(np.searchsorted(record.stamps_s, at.real, side="right") - 1, 0, len(values) - 2)
    before, after = record.stamps_s[row], record.stamps_s[row + 1]
    share = (at - before) / (after - before)
    share = np.where((share.real < 0.0) | (share.real > 1.0), np.clip(share.real, 0.0, 1.0), share)
    seen = values[row] + share[:, None] * (values[row + 1] - values[row])

    times = np.concatenate([record.stamps_s.astype(at.dtype), at])
    order = np.argsort(times.real, kind="stable")
    gained = np.diff(np.concatenate([values.astype(seen.dtype), seen])[order], axis=0)
    seconds = np.diff(times[order])
    first = np.empty(len(order), np.intp)
    first[order] = np.arange(len(order))
    first = first[len(values) :]

    motion = _motion(record, gained, seconds, parameters)
    heading = np.concatenate([[0.0], np.cumsum(motion[:, 1])])
    half = 0.5 * motion[:, 1]
    middle = heading[:-1] + half
    chord = motion[:, 0] * _sinc(half)
    x = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    places = np.column_stack([x, y, heading])
    steps = _Steps(first, motion, middle, places, seconds.real)
    return _between(places[first]), steps


def _motion(record: OdometryRecord, gained: Numbers, seconds: Numbers, parameters: Numbers) -> Numbers:
    """Forward and turn (K, 2) of what each step added to the cumulative values (K, 2)."""
    if record.by_wheels:
        left, right = gained[:, 0] * parameters[0], gained[:, 1] * parameters[1]
        return np.column_stack([0.5 * (left + right), (right - left) / parameters[2]])
    return np.column_stack(
        [parameters[0] * gained[:, 0], parameters[1] * gained[:, 1] + parameters[2] * seconds]
    )


def _sinc(angle: Numbers) -> Numbers:
    """sin(x) / x."""
    small = np.abs(angle.real) < 1e-4
    safe = np.where(small, 1.0, angle)
    ratio: Numbers = np.where(small, 1.0 - angle * angle / 6.0, np.sin(safe) / safe)
    return ratio


def _between(places: Numbers) -> Numbers:
    """The motions (F - 1, 3) between consecutive poses (F, 3), each seen from the one before."""
    dx, dy = places[1:, 0] - places[:-1, 0], places[1:, 1] - places[:-1, 1]
    cos, sin = np.cos(places[:-1, 2]), np.sin(places[:-1, 2])
    return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, places[1:, 2] - places[:-1, 2]])


def _covariances(
    record: OdometryRecord, steps: _Steps, parameters: Array, noise: OdometryNoise
) -> NDArray[np.float64]:
    """Sum up what the random errors of each step do to the motion that it is part of, (F - 1, 3, 3).

    The errors are those of `localization.odometry`'s steps; an error of a turn moves the motion's end about the
    place where it was made.
    """
    random = _random(record, steps, parameters, noise)
    which = np.searchsorted(steps.first, np.arange(len(steps.motion)), side="right") - 1
    inside = (which >= 0) & (which < len(steps.first) - 1)
    which, random = which[inside], random[inside]
    places, middle = steps.places.real, steps.middle.real[inside]
    start, end = places[steps.first[which]], places[steps.first[which + 1]]
    lever = end[:, :2] - 0.5 * (places[:-1][inside, :2] + places[1:][inside, :2])
    ahead = middle - start[:, 2]
    cos, sin = np.cos(start[:, 2]), np.sin(start[:, 2])
    lever_x, lever_y = cos * lever[:, 0] + sin * lever[:, 1], cos * lever[:, 1] - sin * lever[:, 0]
    zero, one = np.zeros_like(ahead), np.ones_like(ahead)
    # Rows x, y, phi of the motion; columns forward, turn, sideways of the step.
    by_step = np.array(
        [
            [np.cos(ahead), -lever_y, -np.sin(ahead)],
            [np.sin(ahead), lever_x, np.cos(ahead)],
            [zero, one, zero],
        ]
    ).transpose(2, 0, 1)
    result = np.zeros((len(steps.first) - 1, 3, 3))
    np.add.at(result, which, by_step @ random @ by_step.transpose(0, 2, 1))
    return result


def _random(record: OdometryRecord, steps: _Steps, parameters: Array, noise: OdometryNoise) -> Array:
    """The covariances (K, 3, 3) of each step's forward, turn and sideways errors."""
    forward, turn = steps.motion.real.T
    result = np.zeros((len(forward), 3, 3))
    if record.by_wheels:
        half = 0.5 * parameters[2] * turn
        left, right = (
            noise.wheel_m2_per_m * np.abs(forward - half),
            noise.wheel_m2_per_m * np.abs(forward + half),
        )
        forward_m2, turn_rad2 = 0.25 * (left + right), (left + right) / parameters[2] ** 2
        result[:, 0, 1] = result[:, 1, 0] = 0.5 * (right - left) / parameters[2]
    else:
        forward_m2 = noise.twist_forward_m2_per_m * np.abs(forward)
        turn_rad2 = noise.twist_turn_rad2_per_rad * np.abs(turn)
        turn_rad2 = turn_rad2 + noise.twist_turn_rad2_per_m * np.abs(forward)
    floor_m2, floor_rad2 = noise.floor_m2_per_s * steps.seconds, noise.floor_rad2_per_s * steps.seconds
    result[:, 0, 0], result[:, 1, 1] = forward_m2 + floor_m2, turn_rad2 + floor_rad2
    result[:, 2, 2] = noise.sideways_share * forward_m2 + floor_m2
    return result
