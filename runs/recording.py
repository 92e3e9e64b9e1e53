"""A run as a rerun recording: one entity tree that explains itself, one file.

    world/map/{segments/<kind>, floor, lintels}     the building
    world/robot/{body, camera/{image, lines/...}}   the published belief, and what its camera saw
    world/window/{outline, regions, segments}       where the matcher was told to look, and what it could see
    world/fixes/{accepted, rejected, ambiguous}     every fix with its 95 % ellipse
    world/beliefs                                   the belief after each look, its 95 % ellipse
    world/tracks/{odometry, filtered, smoothed, truth}
    plots/{position, heading}, plots/drift/...      3 sigma, and errors where there is a truth; of odometry apart
    plots/{nis, lines, hypotheses, timing, state}   a point a look
    decisions                                       a line of text a look: what became of it, and why
    run                                             the configuration with which it ran

Timelines: `sim_time`, seconds as in the session's files, and `frame`, counted from 0.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from maps.outcomes import FIX_POSITION_STD_M, Ambiguous, Fix, Outcome, PoseBelief, Reason, SearchWindow
from maps.regioncache import cached_regions
from runs.blueprint import Arrangement, arrange
from runs.config import LIBRARIES, RunConfig, config_text
from runs.logdetail import LogDetail
from runs.lookscene import log_look, log_picture, style_looks
from runs.rowbatch import RowBatch
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.scene import log_body, log_camera, log_estimate, log_fix, log_map, style_fixes
from runs.session import Frame, Session
from runs.timelines import log_decision, log_step_plots, style_plots
from runs.tracklog import TrackLog
from runs.tracks import errors_of
from runs.windowscene import WindowScene, log_outline, style_windows
from vision.encoding import LeanImages

#: After so many looks what is logged goes to the file: each time costs two kilobytes an entity.
LOOKS_BATCH = 10

#: A viewer is to see at once what is logged; a file waits for its batch.
LIVE_FLUSH_S, FILE_FLUSH_S = 0.2, 3600.0

#: An image's share of a frame of 45 kB, for 640 x 480 pixels; larger ones get more in proportion.
IMAGE_BYTES, IMAGE_PIXELS = 24_000, 640 * 480


class RerunLog:
    """Write a run into one rerun file, or to one viewer, while it goes; a `runs.runlog.RunLog`.

    Where there is a truth, `truth` follows `finish`; `close` comes last. Should the process be killed,
    the file opens with all but the last `LOOKS_BATCH` looks and what was believed since.
    """

    def __init__(self, sink: Path | str, detail: LogDetail = LogDetail.FULL) -> None:
        """Write to a file, or to a viewer at a URL; `detail` below FULL leaves out pictures and lines."""
        batches = rr.ChunkBatcherConfig()
        to_file = isinstance(sink, Path)
        batches.flush_tick = FILE_FLUSH_S if to_file else LIVE_FLUSH_S
        self._batch = LOOKS_BATCH if to_file else 1
        self._sink, self._pictured = sink, detail is LogDetail.FULL
        self._recording = rr.RecordingStream("wireloc", batcher_config=batches)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._tracks, self._rows = TrackLog(self._recording), RowBatch(self._recording)
        self._names: tuple[str, ...] = ()
        self._arrangement = Arrangement()
        self._window: WindowScene | None = None
        self._images = LeanImages(IMAGE_BYTES)
        # Encoding takes longer than all the rest, and nothing waits for it.
        self._hand = ThreadPoolExecutor(max_workers=1, thread_name_prefix="picture")
        self._gate, self._state = 1.0, ""
        self._trajectories: dict[str, Trajectory] = {}

    def begin(self, session: Session, config: RunConfig) -> None:
        """Open the sink with its arrangement of views, the map and the camera."""
        self._gate = config.localizer.gate
        wire_map, camera = session.wire_map, session.camera
        bounds = np.reshape(wire_map.floor.bounds, (2, 2)) if wire_map is not None else None
        self._arrangement = Arrangement(
            bounds, bool(session.frames) and self._pictured, span_s=_span_s(session)
        )
        self._open()
        self._recording.send_recording_name(session.name)
        self._tell(session, config)
        for style in (style_plots, style_windows, style_fixes):
            style(self._recording)
        if wire_map is not None:
            log_map(self._recording, wire_map)
            self._names = wire_map.names
        if camera is not None and session.frames:
            log_camera(self._recording, camera)
            if self._pictured:
                style_looks(self._recording)
            share = camera.width * camera.height / IMAGE_PIXELS
            self._images = LeanImages(round(IMAGE_BYTES * max(share, 1.0)))
            if wire_map is not None and self._pictured:
                height = camera.mount.height_m
                self._window = WindowScene(wire_map, camera, cached_regions(wire_map, (height, height)))

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Log one look at the world: picture, pairs, decision, and what they cost."""
        number = self._tracks.looks
        self._rows.look(record.stamp_ns, number)
        if frame is not None and self._pictured and record.reason != Reason.UNREADABLE_IMAGE:
            self._hand.submit(self._picture, frame, record.stamp_ns, number)
            log_look(self._rows, outcome.look, self._names)
        if self._window is not None:
            self._window.log(self._rows, window)
        else:
            log_outline(self._rows, window)
        self._log_fixes(record, outcome)
        log_estimate(self._rows, record)
        log_step_plots(self._rows, record, outcome, self._gate)
        log_decision(self._rows, number, record, self._state)
        if record.state != self._state:
            self._state = record.state
            self._set_time(record.stamp_ns, number)
            log_body(self._recording, record.state)
        self._tracks.look(record.stamp_ns)
        if self._tracks.looks % self._batch == 0:
            self._rows.send()
            self._tracks.flush()
            self._recording.flush()

    def belief(self, belief: PoseBelief) -> None:
        """Take the belief published after an odometry step."""
        self._tracks.belief(belief)

    def finish(self, trajectories: Trajectories) -> None:
        """Log the tracks that are known only when a run is over."""
        self._rows.send()
        self._tracks.flush()
        self._trajectories = trajectories.by_name()
        for name, track in self._trajectories.items():
            if name not in ("vision", "filtered"):
                self._tracks.track(name, track)
        if self._arrangement.bounds is None:
            points = np.vstack([track.poses[:, :2] for track in self._trajectories.values()])
            bounds = np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else None
            self._arrangement = replace(self._arrangement, bounds=bounds)
            self._recording.send_blueprint(arrange(self._arrangement))

    def truth(self, truth: Trajectory) -> None:
        """Log the true track and the errors of all the others; headings may be NaN."""
        self._tracks.truth(truth)
        for name, track in self._trajectories.items():
            error = errors_of(track, truth)
            # To the scale of dead reckoning, or of fixes that leave a direction open, the others would be flat.
            plot = "drift/" if name == "odometry" else ""
            shown = _whole(track) if name == "vision" else np.ones(len(track), bool)
            stamps_ns = track.stamps_ns[shown]
            self._tracks.series(f"{plot}position/{name}", stamps_ns, error.position_m[shown])
            self._tracks.series(f"{plot}heading/{name}", stamps_ns, np.degrees(error.heading_rad[shown]))

    def close(self) -> None:
        """Write what is left and close the sink."""
        self._rows.send()
        self._tracks.flush()
        self._hand.shutdown(wait=True)
        self._recording.flush()
        self._recording.disconnect()

    def _open(self) -> None:
        layout = arrange(self._arrangement)
        if isinstance(self._sink, Path):
            self._recording.save(self._sink, default_blueprint=layout)
        else:
            self._recording.connect_grpc(self._sink, default_blueprint=layout)

    def _tell(self, session: Session, config: RunConfig) -> None:
        """Say what ran: properties of the recording, and the configuration as a text."""
        told = {library.replace("-", "_"): version(library) for library in LIBRARIES}
        told |= {"session": session.name, "map": str(session.map_path or "none"), "seed": str(config.seed)}
        self._recording.send_property("run", rr.AnyValues(drop_untyped_nones=True, **told))
        text = "\n".join(f"- {name}: {value}" for name, value in told.items())
        document = f"# {session.name}\n\n{text}\n\n```yaml\n{config_text(config)}```\n"
        self._recording.log("run", rr.TextDocument(document, media_type="text/markdown"), static=True)

    def _picture(self, frame: Frame, stamp_ns: int, number: int) -> None:
        jpeg = self._images.lean(frame.data())
        if jpeg is not None:
            # A thread has times of its own.
            self._set_time(stamp_ns, number)
            log_picture(self._recording, jpeg)

    def _set_time(self, stamp_ns: int, number: int) -> None:
        self._recording.set_time("sim_time", duration=np.timedelta64(stamp_ns, "ns"))
        self._recording.set_time("frame", sequence=number)

    def _log_fixes(self, record: StepRecord, outcome: Outcome) -> None:
        match outcome:
            case Fix():
                layer = "accepted" if record.accepted else "rejected"
                nis = "" if record.nis is None else f"  NIS {record.nis:.1f}"
                words = " ".join(word for word in (record.outcome, record.verdict, record.reason) if word)
                log_fix(self._rows, layer, [outcome.belief], [f"{words}{nis}"])
            case Ambiguous():
                labels = [f"AMBIGUOUS  {100.0 * share:.0f} %" for share in outcome.odds]
                log_fix(self._rows, "ambiguous", outcome.beliefs, labels)


def _span_s(session: Session) -> tuple[float, float]:
    """Return when a session begins and ends, in seconds."""
    looks_ns = [frame.stamp_ns for frame in session.frames] + [fix.stamp_ns for fix in session.fixes]
    end_ns = max([int(session.odometry.stamps_ns[-1]), *looks_ns])
    return session.start_ns / 1e9, end_ns / 1e9


def _whole(track: Trajectory) -> NDArray[np.bool_]:
    """Mark the fixes that know their position in every direction, (N,)."""
    if track.covariances is None:
        return np.ones(len(track), bool)
    worst = np.linalg.eigvalsh(track.covariances[:, :2, :2])[:, -1]
    return np.asarray(np.sqrt(worst) < FIX_POSITION_STD_M, bool)
