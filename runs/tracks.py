"""How far a trajectory is from a reference: pose by pose, against its covariance, and in summary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, wrap_angle
from runs.runlog import Trajectory

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Spread:
    """How errors are distributed: median, 95th percentile, largest, root mean square; None if unknown."""

    median: float | None = None
    p95: float | None = None
    max: float | None = None
    rmse: float | None = None


def spread(values: Array) -> Spread:
    """Summarize values, leaving out those that are not known (NaN)."""
    known = values[np.isfinite(values)]
    if not len(known):
        return Spread()
    return Spread(
        median=float(np.median(known)),
        p95=float(np.percentile(known, 95.0)),
        max=float(known.max()),
        rmse=float(np.sqrt(np.mean(known**2))),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Estimates less truth at the same stamps: `difference` (N, 3) in x, y [m], phi [rad].

    NaN where the truth is not known: outside its range of time, or without headings. `covariances`:
    (N, 3, 3) of the estimates, or None.
    """

    difference: Array
    covariances: Array | None

    @property
    def position_m(self) -> Array:
        """Distances from the truth, (N,)."""
        return np.hypot(self.difference[:, 0], self.difference[:, 1])

    @property
    def heading_rad(self) -> Array:
        """How far headings are off, not negative, (N,)."""
        return np.abs(self.difference[:, 2])

    def nees(self) -> tuple[Array, Array]:
        """Return the normalized squared error of what is measured and known, and its dimension, (N,)."""
        count = len(self.difference)
        squared, dimensions = np.full(count, np.nan), np.zeros(count)
        if self.covariances is None:
            return squared, dimensions
        measured = np.isfinite(np.diagonal(self.covariances, axis1=1, axis2=2))
        known = np.isfinite(self.difference) & measured
        position, heading = known[:, :2].all(axis=1), known[:, 2]
        for rows, size in ((position & heading, 3), (position & ~heading, 2)):
            error, sigma = self.difference[rows, :size], self.covariances[rows, :size, :size]
            weighted = np.linalg.solve(sigma, error[:, :, None])[:, :, 0]
            squared[rows], dimensions[rows] = (error * weighted).sum(axis=1), size
        return squared, dimensions

    def anees(self) -> float | None:
        """Return the mean of error squared over dimension, 1 where the covariance is honest."""
        squared, dimensions = self.nees()
        judged = np.isfinite(squared)
        return float(np.mean(squared[judged] / dimensions[judged])) if judged.any() else None

    def only(self, rows: Flags) -> Errors:
        """Return the errors of some rows."""
        return Errors(self.difference[rows], None if self.covariances is None else self.covariances[rows])


def errors_of(track: Trajectory, reference: Trajectory | None) -> Errors:
    """Compare a trajectory with a reference at the trajectory's stamps; without one nothing is known."""
    if reference is None:
        return Errors(np.full((len(track), 3), np.nan), track.covariances)
    difference = headings_known(track) - interpolate(track.stamps_ns, reference)
    difference[:, 2] = wrap_angle(difference[:, 2])
    return Errors(difference, track.covariances)


def along_and_across(track: Trajectory, reference: Trajectory) -> tuple[Array, Array]:
    """Return how far poses are off along the reference's heading and across it, not negative, (N,) metres each.

    NaN where the reference's pose or heading is not known.
    """
    truth = interpolate(track.stamps_ns, reference)
    east, north = (track.poses[:, :2] - truth[:, :2]).T
    cos, sin = np.cos(truth[:, 2]), np.sin(truth[:, 2])
    return np.abs(cos * east + sin * north), np.abs(cos * north - sin * east)


def headings_known(track: Trajectory) -> Array:
    """Return the poses, (N, 3), with NaN for each heading that was not measured."""
    poses = track.poses.copy()
    if track.covariances is not None:
        poses[np.isinf(track.covariances[:, 2, 2]), 2] = np.nan
    return poses


def interpolate(stamps_ns: NDArray[np.int64], track: Trajectory) -> Array:
    """Return a trajectory's poses at other stamps, (N, 3); NaN outside its range of time.

    Linear between neighbours, the heading along the short way.
    """
    if not len(track):
        return np.full((len(stamps_ns), 3), np.nan)
    start_ns = track.stamps_ns[0]
    at, known = (stamps_ns - start_ns).astype(np.float64), (track.stamps_ns - start_ns).astype(np.float64)
    x, y, phi = track.poses.T
    # Unwrapped over the gaps, so that a heading left out does not spoil those after it.
    given = np.isfinite(phi)
    phi = phi.copy()
    phi[given] = np.unwrap(phi[given])
    columns = [np.interp(at, known, column, left=np.nan, right=np.nan) for column in (x, y, phi)]
    return np.column_stack([columns[0], columns[1], wrap_angle(columns[2])])
