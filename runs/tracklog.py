"""Beliefs and tracks on their way into a recording: in batches, thinned, each piece at its own time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from maps.outcomes import PoseBelief
from maps.poses import Array
from runs.palette import TRACKS, TRUTH, rgb
from runs.runlog import Trajectory
from runs.scene import LIFT_M

Times = NDArray[np.int64]

#: Beliefs go to the file in batches, also where no look comes: one at a time would cost a third of a millisecond.
BATCH = 1000

#: A robot that moves 20 times a second moves smoothly; more would only be more bytes.
POSE_STEP_NS = 5 * 10**7

#: Five values a second draw the same plot as all of them, in a fraction of the file.
SERIES_STEP_NS = 2 * 10**8

#: A track is broken where it has no pose for longer than this: nobody knows what it did there.
GAP_NS = 2 * 10**9


class TrackLog:
    """Write beliefs as they come, and whole tracks at the end, on both timelines."""

    def __init__(self, recording: rr.RecordingStream, root: str = "", start_ns: int | None = None) -> None:
        """Write below an entity, for runs side by side.

        `start_ns`: where given, the second timeline is not `frame` but `since_start`, the time since then.
        """
        self._recording, self._root, self._start_ns = recording, root, start_ns
        self._looks_ns: list[int] = []
        self._beliefs: list[PoseBelief] = []
        self._written: list[PoseBelief] = []

    @property
    def looks(self) -> int:
        """How many looks there were."""
        return len(self._looks_ns)

    def look(self, stamp_ns: int) -> None:
        """Take note of a look: it begins the next frame of the timeline `frame`."""
        self._looks_ns.append(stamp_ns)

    def belief(self, belief: PoseBelief) -> None:
        """Take the belief published after an odometry step."""
        self._beliefs.append(belief)
        if len(self._beliefs) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Send the beliefs gathered since the last time: robot, 3 sigma, a piece of the track."""
        if not self._beliefs:
            return
        track = Trajectory.of_beliefs(self._beliefs)
        self.robot(track)
        covariances = np.array([belief.covariance for belief in self._beliefs])
        worst_m = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1])
        heading_deg = np.degrees(np.sqrt(covariances[:, 2, 2]))
        self.series("position/three_sigma", track.stamps_ns, 3.0 * worst_m)
        self.series("heading/three_sigma", track.stamps_ns, 3.0 * heading_deg)
        self.track("filtered", Trajectory.of_beliefs(self._written + self._beliefs))
        self._written = self._beliefs[-1:]
        self._beliefs = []

    def track(self, name: str, track: Trajectory) -> None:
        """Send a track in pieces of a second, each at its end, so that it grows with the time shown."""
        if len(track) < 2:
            return
        points, seconds = on_floor(track), track.stamps_ns // 10**9
        ends = np.append(np.flatnonzero(np.diff(seconds)), len(track) - 1)
        gaps = np.flatnonzero(np.diff(track.stamps_ns) > GAP_NS)
        starts = np.append(0, ends[:-1])
        starts += np.isin(starts, gaps)
        # A second that ends where a gap begins has nothing to draw.
        starts, ends = starts[starts <= ends], ends[starts <= ends]
        colour, _ = TRACKS[name]
        style = rr.LineStrips3D.from_fields(colors=rgb(colour), radii=rr.Radius.ui_points(1.5))
        self._recording.log(f"{self._root}world/tracks/{name}", style, static=True)
        pieces = [
            _thinned(track.stamps_ns[start : end + 1], points[start : end + 1])
            for start, end in zip(starts, ends, strict=True)
        ]
        columns = rr.LineStrips3D.columns(strips=pieces)
        self._recording.send_columns(
            f"{self._root}world/tracks/{name}", self._times(track.stamps_ns[ends]), columns
        )

    def truth(self, truth: Trajectory) -> None:
        """Send the true track, there at all times."""
        points = _thinned(truth.stamps_ns, on_floor(truth))
        line = rr.LineStrips3D([points], colors=rgb(TRUTH), radii=rr.Radius.ui_points(1.0))
        self._recording.log(f"{self._root}world/tracks/truth", line, static=True)

    def series(self, path: str, stamps_ns: Times, values: Array) -> None:
        """Send a plot's values, thinned; those that are not known are left out."""
        known = np.isfinite(values) & spaced(stamps_ns, SERIES_STEP_NS)
        if not known.any():
            # The viewer does not survive a column without times.
            return
        columns = rr.Scalars.columns(scalars=values[known])
        self._recording.send_columns(f"plots/{path}", self._times(stamps_ns[known]), columns)

    def robot(self, track: Trajectory) -> None:
        """Send the robot's pose, thinned."""
        shown = spaced(track.stamps_ns, POSE_STEP_NS)
        poses = track.poses[shown]
        zeros, half = np.zeros(len(poses)), poses[:, 2] / 2.0
        transforms = rr.Transform3D.columns(
            translation=np.column_stack([poses[:, :2], zeros]),
            quaternion=np.column_stack([zeros, zeros, np.sin(half), np.cos(half)]),
        )
        self._recording.send_columns(
            f"{self._root}world/robot", self._times(track.stamps_ns[shown]), transforms
        )

    def _times(self, stamps_ns: Times) -> Sequence[rr.TimeColumn]:
        """Return both timelines' columns; between two looks it is already the later one's frame."""
        times = rr.TimeColumn("sim_time", duration=stamps_ns.astype("timedelta64[ns]"))
        if self._start_ns is not None:
            since = (stamps_ns - self._start_ns).astype("timedelta64[ns]")
            return times, rr.TimeColumn("since_start", duration=since)
        frames = np.searchsorted(np.sort(self._looks_ns), stamps_ns)
        return times, rr.TimeColumn("frame", sequence=frames)


def spaced(stamps_ns: Times, step_ns: int) -> NDArray[np.bool_]:
    """Mark the first stamp in each interval of `step_ns`, (N,)."""
    return np.diff(stamps_ns // step_ns, prepend=-1) > 0


def on_floor(track: Trajectory) -> Array:
    """Return a track's positions at the height where tracks are drawn, (N, 3)."""
    return np.column_stack([track.poses[:, :2], np.full(len(track), LIFT_M["track"])])


def _thinned(stamps_ns: Times, points: Array) -> Array:
    """Leave out points that no eye would miss; the ends stay."""
    kept = spaced(stamps_ns, SERIES_STEP_NS)
    kept[[0, -1]] = True
    return points[kept]
