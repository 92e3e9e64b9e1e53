"""The extended Kalman filter over (x, y, phi): filterpy behind three functions on beliefs."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.stats import chi2

from localization.odometry import OdometryStep, advance, motion_jacobians, motion_noise
from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2, wrap_angle


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """What a fix says beyond the belief: z - h(x), (d,), and its covariance S, (d, d).

    `nis` is the squared Mahalanobis length of the residual, chi-square with `dof` degrees.
    """

    residual: Array
    covariance: Array

    @property
    def dof(self) -> int:
        """How many components the fix measured."""
        return len(self.residual)

    @property
    def nis(self) -> float:
        """The normalized innovation squared."""
        return float(self.residual @ np.linalg.solve(self.covariance, self.residual))

    def inside(self, probability: float) -> bool:
        """Tell whether the residual lies within the ellipse that holds this probability."""
        return self.nis <= quantile(probability, self.dof)


class _ArcFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter; its predict() is linear, this one moves along the arc."""

    x: Array
    P: Array

    def predict_x(self, u: OdometryStep) -> None:
        self.x = advance(Pose2.from_array(self.x), u).as_array()

    def belief(self, stamp_ns: int) -> PoseBelief:
        # Rounding leaves P slightly unsymmetric, and filterpy does not wrap the state.
        return PoseBelief(stamp_ns, Pose2.from_array(self.x), 0.5 * (self.P + self.P.T))


#: Never run itself. filterpy's methods replace its arrays and change none in place, so a shallow copy is
#: a filter of its own, made in a quarter of the time.
_BLANK = _ArcFilter(dim_x=3, dim_z=3)


def _filter_at(belief: PoseBelief) -> _ArcFilter:
    ekf = copy(_BLANK)
    ekf.x, ekf.P = belief.pose.as_array(), belief.covariance
    return ekf


def predict(belief: PoseBelief, step: OdometryStep) -> PoseBelief:
    """Move a belief along a step: x = f(x, u), P = F P F' + G M G' (Thrun et al., table 3.3)."""
    ekf = _filter_at(belief)
    ekf.F, by_motion = motion_jacobians(belief.pose, step)
    ekf.Q = motion_noise(belief.pose, step, by_motion)
    ekf.predict(step)
    return ekf.belief(step.stamp_ns)


def innovation(belief: PoseBelief, fix: PoseBelief) -> Innovation:
    """Compare a fix with the belief at its stamp, in the components that the fix measured."""
    measured = fix.measured
    residual = fix.pose.minus(belief.pose)[measured]
    rows = np.ix_(measured, measured)
    return Innovation(residual, (belief.covariance + fix.covariance)[rows])


def update(belief: PoseBelief, fix: PoseBelief) -> PoseBelief:
    """Fuse a fix into the belief at its stamp, in the components that the fix measured.

    P is filterpy's Joseph form, (I - K H) P (I - K H)' + K R K', positive whatever the gain.
    """
    measured = fix.measured
    rows = np.eye(3)[measured]
    ekf = _filter_at(belief)
    ekf.update(
        fix.pose.as_array()[measured],
        HJacobian=lambda _: rows,
        Hx=lambda x: rows @ x,
        R=fix.covariance[np.ix_(measured, measured)],
        residual=lambda z, expected: _difference(rows, z, expected),
    )
    return ekf.belief(belief.stamp_ns)


def _difference(rows: Array, z: Array, expected: Array) -> Array:
    difference = z - expected
    return np.where(rows[:, 2] > 0.0, wrap_angle(difference), difference)


@lru_cache(maxsize=32)
def quantile(probability: float, dof: int) -> float:
    """Return the chi-square value that `dof` degrees of freedom stay below with this probability."""
    return float(chi2.ppf(probability, dof))
