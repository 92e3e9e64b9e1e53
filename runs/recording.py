"""A run as a rerun recording: one entity tree that explains itself, one file.

    world/map/{segments/<kind>, floor, lintels}     the building
    world/robot/{body, camera/{image, lines/...}}   the published belief, and what its camera saw
    world/window                                    where the matcher was told to look
    world/fixes/{accepted, rejected, ambiguous}     every fix with its 95 % ellipse
    world/tracks/{odometry, filtered, smoothed, truth}
    plots/{position, heading}                       3 sigma, and errors where there is a truth
    plots/{nis, lines, timing, state}, decisions    a point, or a line of text, a look

Timelines: `sim_time`, seconds as in the session's files, and `frame`, counted from 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from maps.outcomes import Ambiguous, Fix, Outcome, PoseBelief, SearchWindow
from maps.poses import Array
from runs.blueprint import arrange
from runs.config import RunConfig
from runs.palette import TRACKS, TRUTH, rgb
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.scene import LIFT_M, log_body, log_camera, log_fix, log_image, log_look, log_map, log_window
from runs.session import Frame, Session
from runs.timelines import log_decision, log_step_plots, style_plots
from runs.tracks import errors_of

#: What is logged reaches the file within two of these; shorter ones make small chunks, each with a
#: kilobyte of overhead.
FLUSH_S = 1.0

#: Beliefs go to the file in batches: one at a time would cost a third of a millisecond each.
BATCH = 250

#: Ten values a second draw the same plot as all of them, in a fraction of the file.
SERIES_STEP_NS = 10**8

#: A track is broken where it has no pose for longer than this: nobody knows what it did there.
GAP_NS = 2 * 10**9


class RerunLog:
    """Write a run into one rerun file while it goes; a `runs.runlog.RunLog`.

    Where there is a truth, `truth` follows `finish`; `close` comes last. Should the process be killed,
    the file opens with all but the looks of the last two seconds and the last `BATCH` beliefs.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        batches = rr.ChunkBatcherConfig()
        batches.flush_tick = FLUSH_S
        self._recording = rr.RecordingStream("wireloc", batcher_config=batches)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._names: tuple[str, ...] = ()
        self._bounds: Array | None = None
        self._has_images = False
        self._gate = 1.0
        self._state = ""
        self._looks_ns: list[int] = []
        self._beliefs: list[PoseBelief] = []
        self._written: list[PoseBelief] = []
        self._trajectories: dict[str, Trajectory] = {}

    def begin(self, session: Session, config: RunConfig) -> None:
        """Open the file with its arrangement of views, the map and the camera."""
        self._gate = config.localizer.gate
        self._has_images = bool(session.frames)
        if session.wire_map is not None:
            self._bounds = np.reshape(session.wire_map.floor.bounds, (2, 2))
        layout = arrange(self._bounds, has_images=self._has_images)
        self._recording.save(self._path, default_blueprint=layout)
        self._recording.send_recording_name(session.name)
        style_plots(self._recording)
        if session.wire_map is not None:
            log_map(self._recording, session.wire_map)
            self._names = session.wire_map.names
        if session.camera is not None and self._has_images:
            log_camera(self._recording, session.camera)

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Log one look at the world: picture, pairs, decision, and what they cost."""
        self._recording.set_time("sim_time", duration=np.timedelta64(record.stamp_ns, "ns"))
        self._recording.set_time("frame", sequence=len(self._looks_ns))
        if record.state != self._state:
            self._state = record.state
            log_body(self._recording, record.state)
        log_window(self._recording, window)
        self._log_fixes(record, outcome)
        if frame is not None:
            log_image(self._recording, frame.path)
            log_look(self._recording, outcome.look, self._names)
        log_step_plots(self._recording, record, outcome, self._gate)
        log_decision(self._recording, len(self._looks_ns), record)
        self._looks_ns.append(record.stamp_ns)

    def belief(self, belief: PoseBelief) -> None:
        """Take the belief published after an odometry step."""
        self._beliefs.append(belief)
        if len(self._beliefs) >= BATCH:
            self._write_beliefs()

    def finish(self, trajectories: Trajectories) -> None:
        """Log the tracks that are known only when a run is over."""
        self._write_beliefs()
        self._trajectories = {name: getattr(trajectories, name) for name in TRACKS}
        self._write_track("odometry", trajectories.odometry)
        self._write_track("smoothed", trajectories.smoothed)
        if self._bounds is None:
            points = np.vstack([track.poses[:, :2] for track in self._trajectories.values()])
            self._bounds = np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else None
            self._recording.send_blueprint(arrange(self._bounds, has_images=self._has_images))

    def truth(self, truth: Trajectory) -> None:
        """Log the true track and the errors of all the others; headings may be NaN."""
        line = rr.LineStrips3D([_on_floor(truth)], colors=rgb(TRUTH), radii=rr.Radius.ui_points(1.0))
        self._recording.log("world/tracks/truth", line, static=True)
        found = {name: errors_of(track, truth) for name, track in self._trajectories.items()}
        for name, error in found.items():
            stamps_ns = self._trajectories[name].stamps_ns
            self._write_series(f"position/{name}", stamps_ns, error.position_m)
            self._write_series(f"heading/{name}", stamps_ns, np.degrees(error.heading_rad))
        # To the scale of dead reckoning, or of a wild fix, these would be flat.
        shown = [error for name, error in found.items() if name in ("filtered", "smoothed")]
        reach = (
            _highest([error.position_m for error in shown]),
            _highest([np.degrees(error.heading_rad) for error in shown]),
        )
        layout = arrange(self._bounds, has_images=self._has_images, highest_errors=reach)
        self._recording.send_blueprint(layout)

    def close(self) -> None:
        """Write what is left and close the file."""
        self._write_beliefs()
        self._recording.flush()
        self._recording.disconnect()

    def _log_fixes(self, record: StepRecord, outcome: Outcome) -> None:
        match outcome:
            case Fix():
                layer = "accepted" if record.accepted else "rejected"
                log_fix(self._recording, layer, [outcome.belief])
            case Ambiguous():
                log_fix(self._recording, "ambiguous", outcome.beliefs)

    def _write_beliefs(self) -> None:
        """Send the beliefs gathered since the last time: robot, 3 sigma, a piece of the track."""
        if not self._beliefs:
            return
        track = Trajectory.of_beliefs(self._beliefs)
        zeros, half = np.zeros(len(track)), track.poses[:, 2] / 2.0
        poses = rr.Transform3D.columns(
            translation=np.column_stack([track.poses[:, :2], zeros]),
            quaternion=np.column_stack([zeros, zeros, np.sin(half), np.cos(half)]),
        )
        self._recording.send_columns("world/robot", self._times(track.stamps_ns), poses)
        covariances = np.array([belief.covariance for belief in self._beliefs])
        worst_m = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1])
        heading_deg = np.degrees(np.sqrt(covariances[:, 2, 2]))
        self._write_series("position/three_sigma", track.stamps_ns, 3.0 * worst_m)
        self._write_series("heading/three_sigma", track.stamps_ns, 3.0 * heading_deg)
        self._write_track("filtered", Trajectory.of_beliefs(self._written + self._beliefs))
        self._written = self._beliefs[-1:]
        self._beliefs = []

    def _write_track(self, name: str, track: Trajectory) -> None:
        """Send a track in pieces of a second, each at its end, so that it grows with the time shown."""
        if len(track) < 2:
            return
        points, seconds = _on_floor(track), track.stamps_ns // 10**9
        ends = np.append(np.flatnonzero(np.diff(seconds)), len(track) - 1)
        gaps = np.flatnonzero(np.diff(track.stamps_ns) > GAP_NS)
        starts = np.append(0, ends[:-1])
        starts += np.isin(starts, gaps)
        colour, _ = TRACKS[name]
        style = rr.LineStrips3D.from_fields(colors=rgb(colour), radii=rr.Radius.ui_points(1.5))
        self._recording.log(f"world/tracks/{name}", style, static=True)
        pieces = [points[start : end + 1] for start, end in zip(starts, ends, strict=True)]
        columns = rr.LineStrips3D.columns(strips=pieces)
        self._recording.send_columns(f"world/tracks/{name}", self._times(track.stamps_ns[ends]), columns)

    def _write_series(self, path: str, stamps_ns: NDArray[np.int64], values: Array) -> None:
        known = np.isfinite(values) & _spaced(stamps_ns)
        columns = rr.Scalars.columns(scalars=values[known])
        self._recording.send_columns(f"plots/{path}", self._times(stamps_ns[known]), columns)

    def _times(self, stamps_ns: NDArray[np.int64]) -> tuple[rr.TimeColumn, rr.TimeColumn]:
        """Return both timelines' columns; between two looks it is already the later one's frame."""
        frames = np.searchsorted(np.sort(self._looks_ns), stamps_ns)
        durations = stamps_ns.astype("timedelta64[ns]")
        return rr.TimeColumn("sim_time", duration=durations), rr.TimeColumn("frame", sequence=frames)


def _spaced(stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the first stamp in each interval of `SERIES_STEP_NS`, (N,)."""
    return np.diff(stamps_ns // SERIES_STEP_NS, prepend=-1) > 0


def _highest(values: list[Array]) -> float:
    """Return the largest finite value, 0 where there is none."""
    together = np.concatenate([np.zeros(1), *values])
    return float(np.max(together[np.isfinite(together)]))


def _on_floor(track: Trajectory) -> Array:
    return np.column_stack([track.poses[:, :2], np.full(len(track), LIFT_M["track"])])
