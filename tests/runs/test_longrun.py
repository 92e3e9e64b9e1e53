"""A robot that never goes home: hours of odometry and fixes, without growth of memory or of time per step."""

from __future__ import annotations

import math
import resource
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from localization.localizer import Localizer, LocalizerConfig
from localization.odometry import OdometryNoise, WheelGeometry, wheel_step
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2

RATE_HZ = 50
WHEELS = WheelGeometry(0.05, 0.05, 0.34)
STD = (0.03, 0.03, 0.01)


def drive(seconds: int, per_minute: int = 60) -> tuple[list[float], list[float], Localizer]:
    """Drive circles with a fix a second, no fix in one of five; return memory [MB] and milliseconds by the minute."""
    rng = np.random.default_rng(5)
    localizer = Localizer(PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag(STD) ** 2), LocalizerConfig())
    noise, period_ns = OdometryNoise(), 10**9 // RATE_HZ
    turn_rad, forward_m = 0.2 / RATE_HZ, 0.4 / RATE_HZ
    left, right = ((forward_m + side * turn_rad * 0.17) / 0.05 for side in (-1.0, 1.0))
    memory, spent = [], []
    began = perf_counter()
    for row in range(seconds * RATE_HZ):
        start_ns, stamp_ns = row * period_ns, (row + 1) * period_ns
        localizer.predict(wheel_step(start_ns, stamp_ns, left, right, WHEELS, noise))
        localizer.estimate_at(stamp_ns)
        if (row + 1) % RATE_HZ == 0:
            localizer.windows_at(stamp_ns)
            localizer.fuse(look(row, stamp_ns, turn_rad, forward_m, rng), None, stamp_ns)
        if (row + 1) % (RATE_HZ * per_minute) == 0:
            memory.append(resident_mb())
            spent.append((perf_counter() - began) * 1e3 / (RATE_HZ * per_minute))
            began = perf_counter()
    return memory, spent, localizer


def look(row: int, stamp_ns: int, turn_rad: float, forward_m: float, rng: np.random.Generator) -> Fix | NoFix:
    """What a camera would have found."""
    if rng.random() < 0.2:
        return NoFix(Reason.TOO_FEW_SEGMENTS)
    phi, radius = (row + 1) * turn_rad, forward_m / turn_rad
    pose = np.array([radius * math.sin(phi), radius * (1.0 - math.cos(phi)), phi]) + rng.normal(size=3) * STD
    return Fix(PoseBelief(stamp_ns, Pose2.from_array(pose), np.diag(STD) ** 2))


def resident_mb() -> float:
    """Return the memory that this process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def check(memory: list[float], spent: list[float], localizer: Localizer, seconds: int) -> None:
    """What must hold after the first minute."""
    print(f"{memory[0]:.1f} MB after a minute, {max(memory):.1f} MB at most")
    print(f"{spent[0]:.3f} ms a step in the first minute, {spent[-1]:.3f} ms in the last")
    assert max(memory) - memory[0] < 50.0
    quarter = max(len(spent) // 4, 1)
    assert np.median(spent[-quarter:]) < 2.0 * np.median(spent[:quarter])
    belief = localizer.belief_at(seconds * 10**9)
    assert belief is not None
    phi = seconds * 0.2
    assert math.hypot(belief.pose.x - 2.0 * math.sin(phi), belief.pose.y - 2.0 * (1.0 - math.cos(phi))) < 0.2


def test_ten_minutes_neither_grow_nor_slow_down() -> None:
    check(*drive(600), 600)


@pytest.mark.slow
def test_eight_hours_neither_grow_nor_slow_down() -> None:
    check(*drive(8 * 3600), 8 * 3600)
