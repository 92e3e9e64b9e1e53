"""The way since a start: dead reckoning in the start's own frame, with the covariance of its drift."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from localization.ekf import Estimate, predict
from localization.odometry import OdometryStep
from maps.outcomes import PoseBelief
from maps.poses import Pose2


class ReckonedPath:
    """Odometry added up from a stamp on; all of it is kept."""

    def __init__(self, start_ns: int) -> None:
        """Begin at a stamp, at the origin."""
        start = PoseBelief(start_ns, Pose2(0.0, 0.0, 0.0), np.zeros((3, 3)))
        # The first step is a motionless one that ends at the start: each estimate has the step that led there.
        self._steps = [OdometryStep(start_ns - 1, start_ns, 0.0, 0.0, np.zeros((2, 2)))]
        self._estimates = [Estimate.of(start)]

    @property
    def steps(self) -> list[OdometryStep]:
        """The steps since the start, without holes."""
        return self._steps[1:]

    def append(self, step: OdometryStep) -> None:
        """Add odometry; what it repeats is left out, what is missing before it is guessed."""
        for piece in self._steps[-1].then(step):
            self._estimates.append(predict(self._estimates[-1], piece))
            self._steps.append(piece)

    def belief_at(self, stamp_ns: int) -> PoseBelief | None:
        """Return start_from_robot at a stamp, guessed beyond the last step; None before the start."""
        last = self._estimates[-1]
        if stamp_ns > last.stamp_ns:
            return predict(last, self._steps[-1].continued(stamp_ns)).belief
        if stamp_ns < self._estimates[0].stamp_ns:
            return None
        after = bisect_left(self._estimates, stamp_ns, key=lambda estimate: estimate.stamp_ns)
        if stamp_ns == self._estimates[after].stamp_ns:
            return self._estimates[after].belief
        before = self._estimates[after - 1]
        return predict(before, self._steps[after].part(before.stamp_ns, stamp_ns)).belief
