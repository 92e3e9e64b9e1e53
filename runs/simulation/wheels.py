"""What wheel encoders, or a robot that reports its twist, make of a drive.

Random errors have the physical form of `localization.odometry.OdometryNoise`: variances that grow with
the way, so that a filter can be told exactly what was simulated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from localization.odometry import WheelGeometry
from maps.poses import Array
from runs.session import Odometry
from runs.simulation.mishaps import Mishaps
from runs.simulation.paths import Drive
from runs.tables import Times


@dataclass(frozen=True, slots=True)
class WheelErrors:
    """How encoders err; what the wheels truly are is the geometry's matter.

    `noise_m2_per_m`: variance of each wheel's roll for each metre it rolls. `slips_per_m`, `slip_m`: how
    often a wheel loses its grip, and how far it then spins on, the mean of an exponential distribution.
    `ticks_per_turn`: of the encoder, 0 for one without steps. `rate_hz`: of the rows, up to the truth's.
    """

    noise_m2_per_m: float = 2e-5
    slips_per_m: float = 0.02
    slip_m: float = 0.005
    ticks_per_turn: int = 4096
    rate_hz: float = 50.0


@dataclass(frozen=True, slots=True)
class TwistErrors:
    """How reported twists err: scales and a bias, and variances that grow with the way.

    `forward_scale`, `turn_scale`: share by which they are too large. `bias_radps`: of the turn rate, while
    the robot moves or not.
    """

    forward_scale: float = 0.0
    turn_scale: float = 0.0
    bias_radps: float = 0.0
    forward_m2_per_m: float = 1e-4
    turn_rad2_per_rad: float = 1e-4
    turn_rad2_per_m: float = 1e-4
    rate_hz: float = 20.0


#: Encoders and twists without any error.
EXACT_WHEELS = WheelErrors(0.0, 0.0, 0.0, 0, 50.0)
EXACT_TWISTS = TwistErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 50.0)
NOTHING = Mishaps()
#: Between the wheels of a robot whose file does not say.
BASELINE_M = 0.4


def simulate_encoders(
    drive: Drive,
    true: WheelGeometry,
    nominal: WheelGeometry,
    errors: WheelErrors,
    rng: np.random.Generator,
    mishaps: Mishaps = NOTHING,
) -> Odometry:
    """Return the cumulative wheel angles of a drive, as a session that knows the `nominal` wheels has them.

    The way that a wheel rolls follows from the true baseline, its angle from its true radius.
    """
    forward, turned = mishaps.steps(drive, true.baseline_m)
    half = 0.5 * true.baseline_m * turned
    rolled = np.column_stack([forward - half, forward + half])
    rolled = rolled + rng.normal(size=rolled.shape) * np.sqrt(errors.noise_m2_per_m * np.abs(rolled))
    slips = rng.random(rolled.shape) < errors.slips_per_m * np.abs(rolled)
    rolled = rolled + slips * np.sign(rolled) * rng.exponential(errors.slip_m, rolled.shape)
    angles = np.concatenate([np.zeros((1, 2)), np.cumsum(rolled, axis=0)])
    angles = angles / [true.left_radius_m, true.right_radius_m]
    rows = _rows(drive, errors.rate_hz)
    values = angles[rows]
    if errors.ticks_per_turn:
        tick = math.tau / errors.ticks_per_turn
        # Counting begins anywhere between two ticks.
        values = tick * np.floor(values / tick + rng.random(2))
        values = values - values[0]
    return Odometry(drive.stamps_ns[rows], drive.stamps_ns[rows], values, nominal)


def simulate_twists(
    drive: Drive,
    errors: TwistErrors,
    rng: np.random.Generator,
    mishaps: Mishaps = NOTHING,
    baseline_m: float = BASELINE_M,
) -> Odometry:
    """Return a drive's twists, the mean of each row until the next; the last row says: standing.

    `baseline_m`: of the wheels behind them, where something goes wrong with those.
    """
    rows = _rows(drive, errors.rate_hz)
    stamps_ns = drive.stamps_ns[rows]
    forward, turned = (np.append(0.0, np.cumsum(steps))[rows] for steps in mishaps.steps(drive, baseline_m))
    forward, turned = np.diff(forward), np.diff(turned)
    seconds = np.diff(stamps_ns) * 1e-9
    noise = rng.normal(size=(2, len(seconds)))
    by_turn = errors.turn_rad2_per_rad * np.abs(turned) + errors.turn_rad2_per_m * np.abs(forward)
    told = (1.0 + errors.forward_scale) * forward + noise[0] * np.sqrt(
        errors.forward_m2_per_m * np.abs(forward)
    )
    told_turn = (1.0 + errors.turn_scale) * turned + errors.bias_radps * seconds + noise[1] * np.sqrt(by_turn)
    values: Array = np.concatenate([np.column_stack([told, told_turn]) / seconds[:, None], np.zeros((1, 2))])
    return Odometry(stamps_ns, stamps_ns, values, None)


def _rows(drive: Drive, rate_hz: float) -> Times:
    """Return the drive's rows nearest to a rate, (R,)."""
    spacing_s = float(drive.stamps_ns[1] - drive.stamps_ns[0]) * 1e-9
    step = max(1, round(1.0 / (rate_hz * spacing_s)))
    return np.arange(0, len(drive.stamps_ns), step)
