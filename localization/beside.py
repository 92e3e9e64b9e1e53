"""A fix that contradicts a belief and yet lies beside it: the covariances are too small, it is no other place.

So it is on a map whose edges are some centimetres off, where neighbouring fixes share their errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from localization.ekf import Estimate
from maps.outcomes import PoseBelief


@dataclass(frozen=True, slots=True)
class BesideConfig:
    """What lies beside a belief.

    `within_m`, `within_rad`: so near. `gates`: within so many times the gate it is fused, with both covariances as
    wide as to agree; `likelihood`: of such a look. Farther out it is an outlier.
    """

    within_m: float = 0.3
    within_rad: float = 0.1
    gates: float = 2.0
    likelihood: float = 0.5


def beside(estimate: Estimate, place: PoseBelief, config: BesideConfig) -> bool:
    """Tell whether a place is too near to be another one; what was not measured is not compared."""
    away = np.where(place.measured, place.pose.minus(estimate.pose), 0.0)
    return math.hypot(away[0], away[1]) <= config.within_m and abs(away[2]) <= config.within_rad
