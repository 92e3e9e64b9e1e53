"""Recordings, read back: what is in the file is what happened."""

import subprocess
import sys
import textwrap
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from shapely.geometry import MultiPolygon, box

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2
from maps.wiremap import WireMap
from runs.config import RunConfig
from runs.recording import RerunLog
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.session import Frame
from vision.camera import Camera, CameraModel, CameraMount

ROOM = WireMap(
    endpoints=np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]], [[4.0, 0.0, 0.0], [4.0, 3.0, 0.0]]]),
    names=("corner one", "skirting one"),
    kinds=("corner", "skirting"),
    sigma_m=np.full(2, 0.01),
    detection_rate=np.full(2, np.nan),
    polarity=np.zeros(2),
    floor=MultiPolygon([box(0.0, 0.0, 4.0, 3.0)]),
    sight_endpoints=np.zeros((2, 2, 3)),
    walls=np.zeros((0, 2, 2)),
    wall_tops_m=np.zeros(0),
    lintels=np.array([[[1.0, 0.0], [2.0, 0.0]]]),
    lintel_bottoms_m=np.array([2.1]),
)

CAMERA = Camera(
    CameraModel.PINHOLE_RADTAN, 64, 48, 50.0, 50.0, 31.5, 23.5, np.zeros(5), CameraMount(height_m=1.2)
)

LOOK = Look(
    lines_px=np.array([[[1.0, 2.0], [3.0, 4.0]], [[5.0, 6.0], [7.0, 8.0]]]),
    predicted_px=np.array([[[1.0, 2.0], [3.0, 4.0]], [[9.0, 9.0], [9.0, 1.0]]]),
    predicted_map=np.array([0, 1]),
    matched_map=np.array([0]),
    matched_image=np.array([1]),
    residuals_px=np.array([0.25]),
)


def belief_at(second, heading_std=0.01):
    deviations = np.array([0.02, 0.02, heading_std])
    return PoseBelief(int(second * 1e9), Pose2(1.0 + 0.1 * second, 1.0, 0.0), np.diag(deviations**2))


def record_at(second, **cells):
    blank = dict.fromkeys(StepRecord.__dataclass_fields__)
    stamp_ns = int(second * 1e9)
    given = {"stamp_ns": stamp_ns, "arrival_ns": stamp_ns, "filename": "", "state": "TRACKING", "reason": ""}
    return StepRecord(**{**blank, **given, **cells})


def write(path, images, *, truth=True):
    """Write four seconds: a fix fused, one refused, an ambiguous look, one without a fix."""
    session = SimpleNamespace(
        name="room",
        wire_map=ROOM if images else None,
        camera=CAMERA if images else None,
        frames=tuple(images),
    )
    outcomes = (
        ({"outcome": "FIX", "verdict": "FUSED", "nis": 2.0, "matches": 1}, Fix(belief_at(1), LOOK)),
        ({"outcome": "FIX", "verdict": "REJECTED", "reason": "GATE", "nis": 99.0}, Fix(belief_at(2), LOOK)),
        ({"outcome": "AMBIGUOUS", "verdict": "MISSED"}, Ambiguous((belief_at(3), belief_at(9)), (0.5, 0.5))),
        ({"outcome": "NO_FIX", "verdict": "MISSED", "reason": "WEAK_EVIDENCE"}, NoFix(Reason.WEAK_EVIDENCE)),
    )
    log = RerunLog(path)
    log.begin(session, RunConfig())
    for second, (cells, outcome) in enumerate(outcomes, start=1):
        for step in range(10):
            log.belief(belief_at(second - 1 + step / 10))
        window = SearchWindow(Pose2(1.0, 1.0, 0.0), 0.3, 0.1)
        frame = images[second - 1] if images else None
        log.step(record_at(second, **cells), frame, outcome, window)
    track = Trajectory.of_beliefs([belief_at(step / 10) for step in range(40)])
    log.finish(Trajectories(track, Trajectory.of_beliefs([belief_at(1), belief_at(2)]), track, track))
    if truth:
        poses = track.poses + [0.0, 0.3, 0.0]
        log.truth(Trajectory(track.stamps_ns, poses))
    log.close()


def rows(path, entity, component):
    """Return all values of a component of an entity, in the order of the file."""
    values = []
    for chunk in RrdReader(path).stream().to_chunks():
        if str(chunk.entity_path) == entity:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                values += batch.column(component).to_pylist()
    return values


def entities(path):
    return {str(chunk.entity_path) for chunk in RrdReader(path).stream().to_chunks()}


@pytest.fixture
def images(tmp_path):
    frames = []
    for second in range(1, 5):
        path = tmp_path / f"{second}.jpg"
        cv2.imwrite(str(path), np.full((48, 64), 40 * second, np.uint8))
        frames.append(Frame(second * 10**9, second * 10**9, path.name, path))
    return frames


def test_recording_holds_the_tree(tmp_path, images):
    path = tmp_path / "run.rrd"
    write(path, images)
    found = entities(path)
    for entity in (
        "/world/map/segments/corner",
        "/world/map/segments/skirting",
        "/world/map/floor",
        "/world/map/lintels",
        "/world/robot",
        "/world/robot/body",
        "/world/robot/camera",
        "/world/robot/camera/lines/extracted",
        "/world/window",
        "/world/fixes/accepted/positions",
        "/world/fixes/rejected/positions",
        "/world/fixes/ambiguous/positions",
        "/world/tracks/odometry",
        "/world/tracks/filtered",
        "/world/tracks/smoothed",
        "/world/tracks/truth",
        "/plots/state",
        "/decisions",
    ):
        assert entity in found, entity


def test_images_are_stored_as_their_files_have_them(tmp_path, images):
    path = tmp_path / "run.rrd"
    write(path, images)
    blobs = rows(path, "/world/robot/camera/image", "EncodedImage:blob")
    assert [bytes(blob[0]) for blob in blobs] == [frame.path.read_bytes() for frame in images]


def test_lines_are_sorted_into_matched_unseen_and_others(tmp_path, images):
    path = tmp_path / "run.rrd"
    write(path, images)
    lines = "/world/robot/camera/lines"
    assert rows(path, f"{lines}/extracted", "LineStrips2D:strips")[0] == [[[1.0, 2.0], [3.0, 4.0]]]
    assert rows(path, f"{lines}/matched", "LineStrips2D:strips")[0] == [[[5.0, 6.0], [7.0, 8.0]]]
    assert rows(path, f"{lines}/matched", "LineStrips2D:labels")[0] == ["corner one  0.25 px"]
    assert rows(path, f"{lines}/predicted_unseen", "LineStrips2D:labels")[0] == ["skirting one"]
    assert rows(path, f"{lines}/matched", "LineStrips2D:strips")[2] == []


def test_fixes_are_layered_by_what_became_of_them(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    accepted, rejected, ambiguous = (
        rows(path, f"/world/fixes/{layer}/positions", "Points3D:positions")
        for layer in ("accepted", "rejected", "ambiguous")
    )
    assert [len(points) for points in accepted] == [1]
    assert accepted[0][0][:2] == pytest.approx([1.1, 1.0])
    assert rejected[0][0][:2] == pytest.approx([1.2, 1.0])
    assert [len(points) for points in ambiguous] == [2]


def test_decisions_tell_the_reason(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    texts = [text[0] for text in rows(path, "/decisions", "TextLog:text")]
    assert texts == [
        "0  FIX  FUSED  1 matches  NIS 2.0",
        "1  FIX  REJECTED  GATE  NIS 99.0",
        "2  AMBIGUOUS  MISSED",
        "3  NO_FIX  MISSED  WEAK_EVIDENCE",
    ]


def test_robot_follows_every_belief_on_both_timelines(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    assert len(rows(path, "/world/robot", "Transform3D:translation")) == 40
    frames = rows(path, "/world/robot", "frame")
    assert frames == sorted(frames)
    assert set(frames) == {0, 1, 2, 3}


def test_errors_are_against_the_truth_and_absent_without(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    errors = [value[0] for value in rows(path, "/plots/position/smoothed", "Scalars:scalars") if value]
    assert errors == pytest.approx([0.3] * 40)
    blind = tmp_path / "blind.rrd"
    write(blind, [], truth=False)
    assert not rows(blind, "/plots/position/smoothed", "Scalars:scalars")
    assert "/world/tracks/truth" not in entities(blind)


def test_track_grows_by_the_second_and_breaks_where_nobody_knows(tmp_path):
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(SimpleNamespace(name="gap", wire_map=None, camera=None, frames=()), RunConfig())
    for second in (0.0, 0.5, 1.0, 1.5, 9.0, 9.5):
        log.belief(belief_at(second))
    log.close()
    strips = rows(path, "/world/tracks/filtered", "LineStrips3D:strips")
    assert [len(strip[0]) for strip in strips if strip] == [2, 3, 2]


def test_recording_carries_its_arrangement(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    assert RrdReader(path).blueprints()


def test_look_costs_little_beside_its_image(tmp_path, images):
    lines = np.random.default_rng(1).uniform(0.0, 640.0, (300, 2, 2))
    look = Look(lines_px=lines, predicted_px=lines[:80], predicted_map=np.zeros(80, np.int64))
    sizes = []
    for looks in (10, 60):
        path = tmp_path / f"{looks}.rrd"
        log = RerunLog(path)
        log.begin(SimpleNamespace(name="lean", wire_map=ROOM, camera=CAMERA, frames=images), RunConfig())
        for second in range(looks):
            for step in range(50):
                log.belief(belief_at(second + step / 50))
            record = record_at(second, outcome="FIX", verdict="FUSED", nis=1.0, segments=300, matches=80)
            log.step(record, images[0], Fix(belief_at(second), look), None)
        log.close()
        sizes.append(path.stat().st_size)
    image = images[0].path.stat().st_size
    assert (sizes[1] - sizes[0]) / 50 - image < 30_000


def test_killed_run_leaves_a_file_that_opens(tmp_path):
    path = tmp_path / "run.rrd"
    script = f"""
        import os, sys, time
        from pathlib import Path
        from types import SimpleNamespace
        from maps.outcomes import NoFix, Reason
        from runs.config import RunConfig
        from runs.recording import FLUSH_S, RerunLog
        from runs.runlog import StepRecord
        log = RerunLog(Path({str(path)!r}))
        log.begin(SimpleNamespace(name="cut", wire_map=None, camera=None, frames=()), RunConfig())
        blank = dict.fromkeys(StepRecord.__dataclass_fields__)
        record = StepRecord(**{{**blank, "stamp_ns": 10**9, "state": "LOST", "outcome": "NO_FIX",
                               "filename": "", "verdict": "MISSED", "reason": "NOTHING_VISIBLE"}})
        log.step(record, None, NoFix(Reason.NOTHING_VISIBLE), None)
        time.sleep(2 * FLUSH_S + 0.5)
        os._exit(1)
    """
    killed = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=False)
    assert killed.returncode == 1
    with pytest.warns(RerunWarning, match="no footer"):
        decisions = rows(path, "/decisions", "TextLog:text")
    assert decisions == [["0  NO_FIX  MISSED  NOTHING_VISIBLE"]]


def test_plots_of_a_look_leave_gaps_where_there_is_nothing(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    first = rows(path, "/plots/lines", "Scalars:scalars")
    assert [np.isnan(row).tolist() for row in first if row] == [[True, True, False]]
    assert [row[0] for row in rows(path, "/plots/nis/innovation", "Scalars:scalars") if row] == [2.0, 99.0]
    bounds = [row[0] for row in rows(path, "/plots/nis/bound", "Scalars:scalars") if row]
    assert bounds == pytest.approx([16.266, 16.266], abs=1e-3)
