"""A camera's pitch and roll, roughly, from frames whose poses are known: which tilt explains the images best.

A tilt that is a degree wrong can pair edges with their neighbours, a skirting's top with the floor behind it, so
well that no small correction leads back. So tilts are tried side by side, before anything is estimated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from maps.poses import Array, Pose2
from runs.robotparameters import with_robot
from runs.robotviews import Shot
from runs.session import Session
from vision.matcher import MatcherConfig
from vision.projection import Projector
from vision.seenlines import MOUNT_PARAMETERS, look_again

_HEIGHT, _PITCH, _ROLL = (MOUNT_PARAMETERS.index(name) for name in ("height_m", "pitch_down_rad", "roll_rad"))


@dataclass(frozen=True, slots=True)
class TiltConfig:
    """Which tilts are tried: up to so many deviations to either side, one step at a time.

    `step_rad`: what a single look puts right by itself. `frames`: looked at with each tilt, evenly over the drive.
    """

    deviations: float = 1.5
    step_rad: float = 0.007
    height_m: float = 0.01
    frames: int = 16


def with_best_tilt(
    session: Session,
    values: Array,
    std: Array,
    shots: Sequence[Shot],
    poses: Mapping[int, Array],
    matcher: MatcherConfig,
    config: TiltConfig,
) -> Array:
    """Return the parameters (10,) with the pitch, then the roll, under which the map explains the frames best.

    `std`: (6,) how far each may be off. `poses`: of shots, by number.
    """
    numbers = sorted(poses)
    some = [
        numbers[at] for at in np.unique(np.linspace(0, len(numbers) - 1, config.frames).round().astype(int))
    ]
    # Just enough freedom to reach the next tilt to be tried.
    narrow = std.copy()
    narrow[[_PITCH, _ROLL]] = 0.5 * config.step_rad
    narrow[_HEIGHT] = min(config.height_m, std[_HEIGHT])
    best = np.array(values)
    for index in (_PITCH, _ROLL):
        reach = round(config.deviations * float(std[index]) / config.step_rad)
        tried = []
        for count in range(-reach, reach + 1):
            trial = best.copy()
            trial[index] += count * config.step_rad
            tried.append((_evidence(with_robot(session, trial, narrow), shots, some, poses, matcher), trial))
        best = max(tried, key=lambda pair: pair[0])[1]
    return best


def _evidence(
    session: Session,
    shots: Sequence[Shot],
    numbers: Sequence[int],
    poses: Mapping[int, Array],
    matcher: MatcherConfig,
) -> float:
    """How well the map explains shots, [nats]; an image that shows nothing counts nothing."""
    assert session.camera is not None
    assert session.wire_map is not None
    projector, total = Projector(session.camera, session.wire_map), 0.0
    for number in numbers:
        pose = Pose2.from_array(poses[number])
        found = look_again(projector, shots[number].lines, pose, matcher.refinement)
        total += 0.0 if found is None else max(found[0].score, 0.0)
    return total
