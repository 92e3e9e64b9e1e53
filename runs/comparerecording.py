"""Several runs in one rerun recording, side by side: the viewer does not synchronize recordings.

    <run>/world/{map, tracks, robot, fixes, beliefs}    each run as its own recording has it
    plots/{position, heading}/<run>/<track>             errors of all runs in one plot
    plots/nis/<run>                                     innovations

Timelines: `sim_time`, as in the sessions' files, and `since_start`, from each run's first pose.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from maps.poses import Array
from runs.blueprint import NIS_SHOWN, ever, eye_above, time_axis
from runs.folder import RunFolder, Step, fix_covariance, to_ns
from runs.palette import FILTERED, FIXED_LAG, ODOMETRY, REJECTED, SMOOTHED, TRACKS, TRUTH, VISION, rgb
from runs.runlog import ACCEPTED
from runs.scene import LIFT_M, flat_lines, log_body, log_map
from runs.shapes import ellipse
from runs.tracklog import TrackLog
from runs.tracks import errors_of

#: Runs take these in the plots where all are drawn.
RUN_COLOURS = (FILTERED, REJECTED, SMOOTHED, FIXED_LAG, ODOMETRY, VISION, TRUTH)

#: Tracks whose errors several runs are compared by; one run alone shows all of its own.
COMPARED = ("filtered", "smoothed")


def record_comparison(path: Path, runs: Sequence[RunFolder]) -> None:
    """Write runs into one rerun file, with a view of the plan for each and plots for all."""
    recording = rr.RecordingStream("wireloc")
    roots = [f"{_root(run.name)}/" for run in runs]
    recording.save(path, default_blueprint=_layout(runs, roots))
    recording.send_recording_name(", ".join(run.name for run in runs))
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    for number, (run, root) in enumerate(zip(runs, roots, strict=True)):
        tracks = TrackLog(recording, root, _start_ns(run))
        _log_scene(recording, tracks, run, root)
        _log_fixes(recording, run, root)
        _log_errors(recording, tracks, run, None if len(runs) == 1 else number)
    recording.flush()
    recording.disconnect()


def _log_scene(recording: rr.RecordingStream, tracks: TrackLog, run: RunFolder, root: str) -> None:
    if run.wire_map is not None:
        log_map(recording, run.wire_map, root)
    for name, track in run.tracks.items():
        if name != "vision":
            tracks.track(name, track)
    if run.truth is not None and len(run.truth):
        tracks.truth(run.truth)
    recording.reset_time()
    log_body(recording, "TRACKING", root)
    if len(run.tracks["filtered"]):
        tracks.robot(run.tracks["filtered"])


def _log_fixes(recording: rr.RecordingStream, run: RunFolder, root: str) -> None:
    """Draw every fix and the belief after each look, each at its time."""
    start_ns = _start_ns(run)
    for step in run.steps:
        stamp_ns = to_ns(step["timestamp_s"])
        recording.set_time("sim_time", duration=np.timedelta64(stamp_ns, "ns"))
        recording.set_time("since_start", duration=np.timedelta64(stamp_ns - start_ns, "ns"))
        if step["fix_x_m"]:
            accepted = step["verdict"] in ACCEPTED
            layer, colour = ("accepted", VISION) if accepted else ("rejected", REJECTED)
            centre = np.array([float(step["fix_x_m"]), float(step["fix_y_m"])])
            lines = flat_lines([ellipse(centre, fix_covariance(step))], LIFT_M["fix"], rgb(colour), 1.0)
            recording.log(f"{root}world/fixes/{layer}", lines)
        if step["x_m"] and step["sxx"]:
            recording.log(f"{root}world/beliefs", _belief(step))
        if step["nis"]:
            recording.log(f"plots/nis/{_root(run.name)}", rr.Scalars(float(step["nis"])))


def _belief(step: Step) -> rr.LineStrips3D:
    sxx, sxy, syy = (float(step[name]) for name in ("sxx", "sxy", "syy"))
    outline = ellipse(np.array([float(step["x_m"]), float(step["y_m"])]), np.array([[sxx, sxy], [sxy, syy]]))
    return flat_lines([outline], LIFT_M["fix"], rgb(FILTERED), 0.5)


def _log_errors(recording: rr.RecordingStream, tracks: TrackLog, run: RunFolder, number: int | None) -> None:
    """Plot a run's errors: of a run alone all tracks, each in its colour; of several some, in the run's."""
    name = _root(run.name)
    recording.reset_time()
    colour = VISION if number is None else RUN_COLOURS[number % len(RUN_COLOURS)]
    points = rr.SeriesPoints(colors=rgb(colour), names=run.name, marker_sizes=3.0)
    recording.log(f"plots/nis/{name}", points, static=True)
    for track_name, track in run.tracks.items():
        chosen = number is None or track_name in COMPARED
        if not chosen or track_name == "vision" or track is run.reference:
            continue
        style = TRACKS[track_name] if number is None else (_shade(colour, track_name), "")
        label = style[1] or f"{run.name}: {TRACKS[track_name][1]}"
        found = errors_of(track, run.reference)
        series = {"position": found.position_m, "heading": np.degrees(found.heading_rad)}
        for plot, values in series.items():
            lines = rr.SeriesLines(colors=rgb(style[0]), names=label, widths=1.5)
            recording.log(f"plots/{plot}/{name}/{track_name}", lines, static=True)
            tracks.series(f"{plot}/{name}/{track_name}", track.stamps_ns, values)


def _shade(colour: str, track: str) -> str:
    """Return a run's colour, paler for its smoothed track."""
    if track != "smoothed":
        return colour
    mixed = [round(0.5 * part + 0.5 * 160) for part in rgb(colour)]
    return "#{:02x}{:02x}{:02x}".format(*mixed)


def _layout(runs: Sequence[RunFolder], roots: Sequence[str]) -> rrb.Blueprint:
    plans = [
        rrb.Spatial3DView(
            origin=f"/{root}world",
            name=run.name,
            contents=["$origin/**"],
            eye_controls=eye_above(_bounds(run)),
            overrides={f"/{root}world/{path}": ever(("sim_time", "since_start")) for path in _trails(run)},
        )
        for run, root in zip(runs, roots, strict=True)
    ]
    together = len({_start_ns(run) for run in runs}) == 1
    first_ns = _start_ns(runs[0]) if together else 0
    longest_ns = max(_end_ns(run) - _start_ns(run) for run in runs)
    span_s = (first_ns / 1e9, (first_ns + longest_ns) / 1e9)
    against = "error" if all(run.truth is not None for run in runs) else "difference from the reference"
    plots = [
        rrb.TimeSeriesView(
            origin=f"/plots/{plot}",
            name=title,
            axis_x=time_axis(span_s),
            axis_y=rrb.ScalarAxis(range=(0.0, NIS_SHOWN)) if plot == "nis" else None,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        )
        for plot, title in (
            ("position", f"Position {against}, m"),
            ("heading", f"Heading {against}, deg"),
            ("nis", "Innovation"),
        )
    ]
    return rrb.Blueprint(
        rrb.Vertical(rrb.Grid(*plans), rrb.Horizontal(*plots), row_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sim_time" if together else "since_start"),
        auto_views=False,
    )


def _trails(run: RunFolder) -> list[str]:
    tracks = [f"tracks/{name}" for name in run.tracks if name != "vision"]
    return [*tracks, "fixes/accepted", "fixes/rejected", "beliefs"]


def _bounds(run: RunFolder) -> Array | None:
    if run.wire_map is not None:
        return np.reshape(run.wire_map.floor.bounds, (2, 2))
    points = np.vstack([track.poses[:, :2] for track in run.tracks.values()])
    return np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else None


def _start_ns(run: RunFolder) -> int:
    """When a run's first track begins, or else its first look."""
    track = run.tracks["odometry"]
    if len(track):
        return int(track.stamps_ns[0])
    return to_ns(run.steps[0]["timestamp_s"]) if run.steps else 0


def _end_ns(run: RunFolder) -> int:
    track = run.tracks["odometry"]
    if len(track):
        return int(track.stamps_ns[-1])
    return to_ns(run.steps[-1]["timestamp_s"]) if run.steps else 1


def _root(name: str) -> str:
    """Return a run's name as one part of an entity path."""
    return re.sub(r"[^\w-]+", "_", name).strip("_") or "run"
