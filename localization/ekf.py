"""The extended Kalman filter over pose and systematic errors: filterpy behind three functions on estimates.

The state is (x, y, phi) and the parameters of odometry's systematic errors (`localization.odometry`), each
a unit normal a priori that slowly forgets (a first-order Gauss-Markov process). A fix tells of the pose
alone; what it says of the parameters comes through their correlation with it.

Random errors have heavy tails: now and then a wheel slips. Beside its covariance an estimate therefore
carries what a slip since the last fix would add to it, and a fix that is more likely after a slip is
judged and fused with the sum: two models, and a decision at every fix (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, section 11.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numba import njit
from scipy.stats import chi2

from localization.motion import carried, moved
from localization.odometry import PARAMETERS, OdometryStep
from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2

#: A wheel slips between one pair of fixes in a hundred; nobody asks before the residual is out of the
#: ordinary.
_SLIP_LOG_ODDS = math.log(0.01 / 0.99)
_ORDINARY = 0.95
#: The ratio of chi-square's quantiles of 99 and 99.9 %, one degree of freedom.
_SLIP_SHARE = float(chi2.ppf(0.99, 1) / chi2.ppf(0.999, 1))

_SIZE = 3 + PARAMETERS
_POSE = np.eye(3, _SIZE)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A Gaussian over the pose and the parameters of the systematic errors at one time.

    `mean`: (7,) x, y [m], phi [rad], then the parameters in their own standard deviations; `joint`: (7, 7),
    its covariance. `slip`: (3, 3), what the pose's covariance would be more if odometry had slipped since
    the last fix. None is copied: whoever makes one hands them over.
    """

    stamp_ns: int
    mean: Array
    joint: Array
    slip: Array

    def __post_init__(self) -> None:
        for values in (self.mean, self.joint, self.slip):
            values.setflags(write=False)

    @classmethod
    def of(cls, belief: PoseBelief) -> Estimate:
        """Begin at a belief, with the parameters as they are a priori."""
        joint = np.eye(_SIZE)
        joint[:3, :3] = belief.covariance
        mean = np.append(belief.pose.as_array(), np.zeros(PARAMETERS))
        return cls(belief.stamp_ns, mean, joint, np.zeros((3, 3)))

    @property
    def pose(self) -> Pose2:
        """The mean of map_from_robot."""
        return Pose2.from_array(self.mean)

    @property
    def covariance(self) -> Array:
        """The pose's covariance, (3, 3)."""
        block = self.joint[:3, :3]
        # Rounding leaves filterpy's P slightly unsymmetric.
        return 0.5 * (block + block.T)

    @property
    def belief(self) -> PoseBelief:
        """What it says of the pose."""
        return PoseBelief(self.stamp_ns, self.pose, self.covariance)

    @property
    def wide(self) -> PoseBelief:
        """The same, wide enough for a slip: where its 99.9 % end, 99 % of what can be after a slip do too."""
        return PoseBelief(self.stamp_ns, self.pose, self.covariance + _SLIP_SHARE * self.slip)


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """What a fix says beyond the belief: z - h(x), (d,), and its covariance S, (d, d).

    `rows`: H, (d, 7), and `noise`: R, (d, d), of the components that the fix measured. `slipped`: S is that of
    odometry that has slipped since the last fix. `nis` is the squared Mahalanobis length of the residual,
    chi-square with `dof` degrees.
    """

    residual: Array
    covariance: Array
    rows: Array
    noise: Array
    slipped: bool = False
    nis: float = field(init=False)
    #: The logarithm of the residual's density, but for a constant.
    log_likelihood: float = field(init=False)

    def __post_init__(self) -> None:
        nis, log_det = _squared_length(self.residual, self.covariance)
        object.__setattr__(self, "nis", nis)
        object.__setattr__(self, "log_likelihood", -0.5 * (nis + log_det))

    @property
    def dof(self) -> int:
        """How many components the fix measured."""
        return len(self.residual)

    def inside(self, probability: float) -> bool:
        """Tell whether the residual lies within the ellipse that holds this probability."""
        return self.nis <= quantile(probability, self.dof)


@njit(cache=True, nogil=True)
def _squared_length(residual: Array, covariance: Array) -> tuple[float, float]:
    """Return r' S^-1 r, and the logarithm of S's determinant, by Cholesky's factors of S."""
    size = len(residual)
    root, whitened = np.zeros((size, size)), np.empty(size)
    squared, log_det = 0.0, 0.0
    for i in range(size):
        left = residual[i]
        for j in range(i + 1):
            rest = covariance[i, j]
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(rest) if i == j else rest / root[j, j]
            if j < i:
                left -= root[i, j] * whitened[j]
        whitened[i] = left / root[i, i]
        squared += whitened[i] ** 2
        log_det += 2.0 * math.log(root[i, i])
    return squared, log_det


class _ArcFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter; its predict() is linear, this one is told where the arc leads."""

    x: Array
    P: Array

    def predict_x(self, u: Array) -> None:
        self.x = u


#: Never run itself. filterpy's methods replace its arrays and change none in place, so one with the same
#: attributes is a filter of its own, made in a fraction of the time.
_BLANK = vars(_ArcFilter(dim_x=_SIZE, dim_z=3))


def _filter_at(estimate: Estimate) -> _ArcFilter:
    ekf = _ArcFilter.__new__(_ArcFilter)
    ekf.__dict__.update(_BLANK)
    ekf.x, ekf.P = estimate.mean, estimate.joint
    return ekf


def predict(estimate: Estimate, step: OdometryStep) -> Estimate:
    """Move an estimate along a step, P = F P F' + Q (Thrun et al., table 3.3).

    The parameters correct the step before it moves the pose.
    """
    ekf = _filter_at(estimate)
    motion = step.forward_m, step.turn_rad
    after, ekf.F, ekf.Q = moved(estimate.mean, motion, step.systematic, step.random, step.forgetting)
    after[2] = _wrapped(after[2])
    ekf.predict(after)
    return Estimate(step.stamp_ns, ekf.x, ekf.P, carried(estimate.slip, ekf.F, step.slip, ekf.Q))


def _wrapped(angle: float) -> float:
    """Wrap one angle, faster than for arrays."""
    wrapped = math.remainder(angle, math.tau)
    return wrapped if wrapped > -math.pi else math.pi


def innovation(estimate: Estimate, fix: PoseBelief) -> Innovation:
    """Compare a fix with the estimate at its stamp, in the components that the fix measured."""
    here, noise, slip = estimate.joint[:3, :3], fix.covariance, estimate.slip
    pose = fix.pose
    x, y, phi = estimate.mean[:3].tolist()
    residual, rows = np.array([pose.x - x, pose.y - y, _wrapped(pose.phi - phi)]), _POSE
    measured = fix.measured
    if not measured.all():
        block = np.ix_(measured, measured)
        here, noise, slip = here[block], noise[block], slip[block]
        residual, rows = residual[measured], _POSE[measured]
    usual = Innovation(residual, here + noise, rows, noise)
    if usual.inside(_ORDINARY):
        return usual
    slipped = Innovation(residual, usual.covariance + slip, rows, noise, slipped=True)
    odds = slipped.log_likelihood - usual.log_likelihood + _SLIP_LOG_ODDS
    return slipped if odds > 0.0 else usual


def update(
    estimate: Estimate, fix: PoseBelief, news: Innovation | None = None, widened: float = 1.0
) -> Estimate:
    """Fuse a fix into the estimate at its stamp, in the components that the fix measured.

    `news`: their innovation, where it is known already. `widened`: both covariances are taken that many times, where
    they cannot both be right. P is filterpy's Joseph form, (I - K H) P (I - K H)' + K R K', positive whatever the
    gain.
    """
    news = news or innovation(estimate, fix)
    ekf = _filter_at(estimate)
    if news.slipped or widened != 1.0:
        ekf.P = np.array(estimate.joint)
        ekf.P[:3, :3] += estimate.slip if news.slipped else 0.0
        ekf.P[:3, :3] *= widened
    # The innovation is given, so that filterpy need not know that angles wrap.
    ekf.update(news.residual, lambda _: news.rows, lambda _: 0.0, R=widened * news.noise)
    mean, joint = np.array(ekf.x), ekf.P + ekf.P.T
    mean[2] = _wrapped(mean[2])
    joint *= 0.5
    return Estimate(estimate.stamp_ns, mean, joint, np.zeros((3, 3)))


@lru_cache(maxsize=32)
def quantile(probability: float, dof: int) -> float:
    """Return the chi-square value that `dof` degrees of freedom stay below with this probability."""
    return float(chi2.ppf(probability, dof))
