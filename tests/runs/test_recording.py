"""Recordings, read back: what is in the file is what happened."""

import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from shapely.geometry import MultiPolygon, box

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, PoseEllipsoid, Reason, SearchWindow
from maps.poses import Pose2
from maps.wiremap import WireMap
from runs.config import RunConfig
from runs.folder import read_steps
from runs.logdetail import LogDetail
from runs.lookscene import residual_colours
from runs.palette import REJECTED, SMOOTHED, rgb
from runs.recording import LOOKS_BATCH, RerunLog
from runs.rowbatch import RowBatch
from runs.runlog import StepRecord, Trajectories, Trajectory
from runs.session import Frame
from runs.windowscene import WindowScene
from tests.conftest import write_toy
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
    polarity=np.array([-1.0, 1.0]),
    selected=2,
    hypotheses=30,
    refined=5,
)


def belief_at(second, heading_std=0.01):
    deviations = np.array([0.02, 0.02, heading_std])
    return PoseBelief(int(second * 1e9), Pose2(1.0 + 0.1 * second, 1.0, 0.0), np.diag(deviations**2))


def record_at(second, **cells):
    blank = dict.fromkeys(StepRecord.__dataclass_fields__)
    stamp_ns = int(second * 1e9)
    given = {"stamp_ns": stamp_ns, "arrival_ns": stamp_ns, "filename": "", "state": "TRACKING", "reason": ""}
    return StepRecord(**{**blank, **given, **cells})


def session_of(images=(), wire_map=None, camera=None, name="room", end_s=4.0):
    """Return what a recording asks of a session."""
    return SimpleNamespace(
        name=name,
        wire_map=wire_map,
        camera=camera,
        map_path=None,
        frames=tuple(images),
        fixes=(),
        start_ns=0,
        odometry=SimpleNamespace(stamps_ns=np.array([0, int(end_s * 1e9)])),
    )


def write(path, images, *, truth=True, detail=LogDetail.FULL):
    """Write four seconds: a fix fused, one refused, an ambiguous look, one without a fix."""
    session = session_of(images, ROOM if images else None, CAMERA if images else None)
    outcomes = (
        (
            {"outcome": "FIX", "verdict": "FUSED", "nis": 2.0, "matches": 1, "hypotheses": 30, "selected": 2},
            Fix(belief_at(1), LOOK),
        ),
        ({"outcome": "FIX", "verdict": "REJECTED", "reason": "GATE", "nis": 99.0}, Fix(belief_at(2), LOOK)),
        ({"outcome": "AMBIGUOUS", "verdict": "MISSED"}, Ambiguous((belief_at(3), belief_at(9)), (0.5, 0.5))),
        (
            {"outcome": "NO_FIX", "verdict": "MISSED", "reason": "WEAK_EVIDENCE", "state": "UNCERTAIN"},
            NoFix(Reason.WEAK_EVIDENCE),
        ),
    )
    log = RerunLog(path, detail)
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
        "/world/robot/camera/lines/extracted/brighter_left",
        "/world/window/outline",
        "/world/window/regions",
        "/world/window/segments",
        "/world/fixes/accepted/positions",
        "/world/fixes/rejected/positions",
        "/world/fixes/ambiguous/positions",
        "/world/tracks/odometry",
        "/world/tracks/filtered",
        "/world/tracks/smoothed",
        "/world/tracks/truth",
        "/plots/state",
        "/plots/hypotheses",
        "/plots/drift/position/odometry",
        "/decisions",
        "/run",
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
    free = rows(path, f"{lines}/extracted/brighter_left", "LineStrips2D:strips")
    assert free[0] == [[[1.0, 2.0], [3.0, 4.0]]]
    assert rows(path, f"{lines}/extracted/brighter_right", "LineStrips2D:strips")[0] == []
    assert rows(path, f"{lines}/matched", "LineStrips2D:strips")[0] == [[[5.0, 6.0], [7.0, 8.0]]]
    assert rows(path, f"{lines}/matched", "LineStrips2D:labels")[0] == ["corner one  0.25 px"]
    assert rows(path, f"{lines}/predicted_unseen", "LineStrips2D:labels")[0] == ["skirting one"]
    assert rows(path, f"{lines}/matched", "LineStrips2D:strips")[2] == []


def test_residuals_go_from_green_to_red():
    colours = residual_colours(np.array([0.0, 99.0]))
    assert colours.tolist() == [list(rgb(SMOOTHED)), list(rgb(REJECTED))]


def test_window_shows_its_regions_and_what_can_be_seen_from_it(tmp_path, images):
    path = tmp_path / "run.rrd"
    write(path, images)
    outline = rows(path, "/world/window/outline", "LineStrips3D:strips")
    assert np.ptp(np.array(outline[0][0]), axis=0)[:2] == pytest.approx([0.6, 0.6], abs=0.01)
    # Both touch the one region that the room is.
    seen = rows(path, "/world/window/segments", "LineStrips3D:strips")
    assert seen[0] == ROOM.endpoints.tolist()
    labels = rows(path, "/world/window/regions", "LineStrips3D:labels")
    assert labels[0]
    assert "segments" in labels[0][0]


def test_segments_of_a_window_are_those_ahead_of_the_camera():
    asked = []
    regions = SimpleNamespace(
        visible=lambda *where: asked.append(where) or np.array([1]),
        touching=lambda *_: np.zeros(0, np.int64),
    )
    mount = CameraMount(x_m=0.2, height_m=1.2, yaw_rad=0.5)
    camera = replace(CAMERA, mount=mount)
    batch = RowBatch(rr.RecordingStream("test"))
    WindowScene(ROOM, camera, regions).log(batch, SearchWindow(Pose2(1.0, 1.0, 0.0), 0.3, 0.1))
    ((point, radius_m, heading_rad, spread_rad),) = asked
    assert point == pytest.approx((1.2, 1.0))
    assert (radius_m, heading_rad) == pytest.approx((0.3, 0.5))
    assert spread_rad == pytest.approx(0.1 + np.arctan(31.5 / 50.0))


def test_window_of_an_ellipse_is_drawn_as_one(tmp_path):
    path = tmp_path / "run.rrd"
    ellipsoid = PoseEllipsoid(Pose2(1.0, 1.0, 0.0), np.diag([0.04, 0.01, 1e-4]), 4.0)
    log = RerunLog(path)
    log.begin(session_of(), RunConfig())
    window = SearchWindow(Pose2(1.0, 1.0, 0.0), 0.5, 0.1, ellipsoid)
    log.step(record_at(1, outcome="NO_FIX", verdict="MISSED"), None, NoFix(Reason.WEAK_EVIDENCE), window)
    log.close()
    (strips,) = rows(path, "/world/window/outline", "LineStrips3D:strips")
    assert np.ptp(np.array(strips[2]), axis=0)[:2] == pytest.approx([0.8, 0.4], abs=0.01)


def test_search_of_the_whole_floor_outlines_it(tmp_path, images):
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(session_of(images, ROOM, CAMERA), RunConfig())
    everywhere = SearchWindow.everywhere()
    log.step(record_at(1, outcome="NO_FIX", verdict="MISSED"), None, NoFix(Reason.WEAK_EVIDENCE), everywhere)
    log.close()
    (strips,) = rows(path, "/world/window/outline", "LineStrips3D:strips")
    assert np.array(strips[0]).max(axis=0)[:2].tolist() == [4.0, 3.0]


def test_belief_after_each_look_has_its_ellipse(tmp_path):
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(session_of(), RunConfig())
    cells = {"x_m": 2.0, "y_m": 1.0, "phi_rad": 0.0, "sxx": 0.01, "sxy": 0.0, "syy": 0.0025}
    record = record_at(1, outcome="NO_FIX", verdict="MISSED", **cells)
    log.step(record, None, NoFix(Reason.WEAK_EVIDENCE), None)
    log.close()
    ((outline,),) = rows(path, "/world/beliefs", "LineStrips3D:strips")
    assert np.ptp(np.array(outline), axis=0)[:2] == pytest.approx(2 * 2.448 * np.array([0.1, 0.05]), rel=0.02)


def test_fixes_alone_leave_out_pictures_and_lines(tmp_path, images):
    path = tmp_path / "run.rrd"
    write(path, images, detail=LogDetail.FIXES)
    found = entities(path)
    assert not any(entity.startswith("/world/robot/camera/") for entity in found)
    assert {"/world/fixes/accepted/positions", "/world/window/outline", "/decisions"} <= found


def test_recording_tells_what_ran(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    (text,) = rows(path, "/run", "TextDocument:text")
    assert "localizer:" in text[0]
    assert "gtsam: " in text[0]
    assert "/__properties/run" in entities(path)


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
    changes = [text[0] for text in rows(path, "/decisions/state", "TextLog:text")]
    assert changes == ["0  begins TRACKING", "3  TRACKING -> UNCERTAIN"]
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
    # Five a second of ten.
    assert errors == pytest.approx([0.3] * 20)
    blind = tmp_path / "blind.rrd"
    write(blind, [], truth=False)
    assert not rows(blind, "/plots/position/smoothed", "Scalars:scalars")
    assert "/world/tracks/truth" not in entities(blind)


def test_no_column_is_without_times(tmp_path):
    """A viewer would end at once on one: here the truth has no headings, and no fix is whole."""
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(session_of(), RunConfig())
    track = Trajectory.of_beliefs([belief_at(step / 10) for step in range(40)])
    vague = PoseBelief(10**9, Pose2(1.0, 1.0, 0.0), np.diag([4.0, 1e-4, 1e-4]))
    log.finish(Trajectories(track, Trajectory.of_beliefs([vague]), track, track))
    log.truth(Trajectory(track.stamps_ns, np.column_stack([track.poses[:, :2], np.full(40, np.nan)])))
    log.close()
    chunks = [chunk for chunk in RrdReader(path).stream().to_chunks() if not chunk.is_static]
    assert chunks
    assert all(chunk.to_record_batch().num_rows for chunk in chunks)
    assert not rows(path, "/plots/heading/smoothed", "Scalars:scalars")
    assert not rows(path, "/plots/position/vision", "Scalars:scalars")


def test_track_grows_by_the_second_and_breaks_where_nobody_knows(tmp_path):
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(session_of(name="gap"), RunConfig())
    for second in (0.0, 0.5, 1.0, 1.5, 9.0, 9.5):
        log.belief(belief_at(second))
    log.close()
    strips = rows(path, "/world/tracks/filtered", "LineStrips3D:strips")
    assert [len(strip[0]) for strip in strips if strip] == [2, 3, 2]


def test_track_of_a_robot_that_was_lost_after_a_single_belief(tmp_path):
    path = tmp_path / "run.rrd"
    log = RerunLog(path)
    log.begin(session_of(name="gap"), RunConfig())
    for second in (0.0, 9.0, 9.5):
        log.belief(belief_at(second))
    log.close()
    strips = rows(path, "/world/tracks/filtered", "LineStrips3D:strips")
    assert [len(strip[0]) for strip in strips if strip] == [2]


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
        log.begin(session_of(images, ROOM, CAMERA, name="lean"), RunConfig())
        for second in range(looks):
            for step in range(50):
                log.belief(belief_at(second + step / 50))
            record = record_at(second, outcome="FIX", verdict="FUSED", nis=1.0, segments=300, matches=80)
            log.step(record, images[0], Fix(belief_at(second), look), None)
        log.close()
        sizes.append(path.stat().st_size)
    image = images[0].path.stat().st_size
    assert (sizes[1] - sizes[0]) / 50 - image < 30_000


KILLED = """
    import sys, time
    from pathlib import Path
    from runs.config import RunConfig
    from runs.navigation import navigate
    from runs.session import read_session

    def slowly(done, total):
        print(done, flush=True)
        time.sleep(0.02)

    navigate(read_session(Path(sys.argv[1])), RunConfig(), Path(sys.argv[2]), slowly)
"""


def test_killed_run_leaves_a_recording_and_steps_that_open(tmp_path):
    session, out = tmp_path / "long", tmp_path / "out"
    session.mkdir()
    write_toy(session, 120.0)
    command = [sys.executable, "-c", textwrap.dedent(KILLED), session, out]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        while int(run.stdout.readline()) < 2 * LOOKS_BATCH + 3:
            pass
        run.send_signal(signal.SIGKILL)
    assert run.returncode == -signal.SIGKILL
    partial = tmp_path / "out.partial"
    assert not out.exists()
    assert len(read_steps(partial)) >= 2 * LOOKS_BATCH + 3
    with pytest.warns(RerunWarning, match="no footer"):
        decisions = rows(partial / "run.rrd", "/decisions", "TextLog:text")
    assert len(decisions) >= 2 * LOOKS_BATCH
    assert decisions[0][0].startswith("0  FIX  FUSED")


def test_plots_of_a_look_leave_gaps_where_there_is_nothing(tmp_path):
    path = tmp_path / "run.rrd"
    write(path, [])
    first = rows(path, "/plots/lines", "Scalars:scalars")
    assert [np.isnan(row).tolist() for row in first if row] == [[True, False, False]]
    (kept,) = [row for row in rows(path, "/plots/hypotheses", "Scalars:scalars") if row]
    assert kept == [2.0, 30.0, 5.0, 1.0]
    assert [row[0] for row in rows(path, "/plots/nis/innovation", "Scalars:scalars") if row] == [2.0, 99.0]
    bounds = [row[0] for row in rows(path, "/plots/nis/bound", "Scalars:scalars") if row]
    assert bounds == pytest.approx([16.266, 16.266], abs=1e-3)
