"""How far a trajectory is from a reference, pose by pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, wrap_angle
from runs.runlog import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class TrackErrors:
    """Distances of a trajectory's poses from a reference; NaN where either is not known.

    `seconds`, `position_m`, `heading_rad`: (N,) each, none negative.
    """

    seconds: Array
    position_m: Array
    heading_rad: Array


def errors(track: Trajectory, reference: Trajectory) -> TrackErrors:
    """Compare a trajectory with a reference, at the trajectory's stamps."""
    difference = headings_known(track) - interpolate(track.stamps_ns, reference)
    position_m = np.hypot(difference[:, 0], difference[:, 1])
    return TrackErrors(track.stamps_ns / 1e9, position_m, np.abs(wrap_angle(difference[:, 2])))


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
    columns = [np.interp(at, known, column, left=np.nan, right=np.nan) for column in (x, y, np.unwrap(phi))]
    return np.column_stack([columns[0], columns[1], wrap_angle(columns[2])])
