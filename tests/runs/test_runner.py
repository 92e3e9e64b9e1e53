"""The main loop: perfect odometry, late fixes, frames, and the truth that makes no difference."""

import dataclasses

import numpy as np
import pytest

from maps.errors import InputError
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.results import FileLog
from runs.runlog import COLUMNS, NullLog
from runs.runner import run_session
from runs.session import read_session
from runs.tracks import errors_of
from vision.matcher import MatcherConfig

CONFIG = RunConfig()
TIMING = [COLUMNS.index(name) for name in ("extract_ms", "match_ms", "update_ms")]


def run(session, log=None):
    return run_session(session, CONFIG, log or NullLog(), lambda *_: None)


def started_wrong(session, pose, std):
    belief = PoseBelief(session.start_ns, pose, np.diag([std**2] * 3))
    return dataclasses.replace(session, initial=belief)


class Diary(NullLog):
    """Remember what a log hears, in order."""

    def __init__(self):
        self.heard = []

    def begin(self, *_):
        self.heard.append("begin")

    def step(self, record, frame, outcome, window):
        self.heard.append((record, frame, outcome, window))

    def belief(self, *_):
        self.heard.append("belief")

    def finish(self, *_):
        self.heard.append("finish")


class TrustedEye:
    """Stands for the matcher: finds the window's centre in the first frame, nothing afterwards."""

    def __init__(self, *_):
        self.config, self.timing_ms = MatcherConfig(), {"extract": 1.0, "match": 2.0}
        self.images = []

    def match(self, image, stamp_ns, window):
        self.images.append(image.shape)
        if len(self.images) > 1:
            return NoFix(Reason.WEAK_EVIDENCE)
        return Fix(PoseBelief(stamp_ns, window.centre, np.diag([1e-4, 1e-4, 1e-5])))


@pytest.fixture
def two_frames(sample, monkeypatch):
    """Return the sample cut after two frames, with the matcher replaced."""
    monkeypatch.setattr("runs.runner.LineMatcher", TrustedEye)
    session = read_session(sample)
    return dataclasses.replace(session, frames=session.frames[:2])


def test_perfect_odometry_and_fixes_keep_every_track_on_the_truth(toy):
    tracks = run(read_session(toy)).trajectories
    truth = read_truth(toy)
    for track in (tracks.odometry, tracks.vision, tracks.filtered, tracks.smoothed):
        # The truth is interpolated along chords of 2 cm.
        assert errors_of(track, truth).position_m.max() < 1e-3


def test_filter_brings_a_wrong_start_home(toy):
    session = started_wrong(read_session(toy), Pose2(1.2, 1.9, 0.5), 0.2)
    result = run(session)
    filtered = errors_of(result.trajectories.filtered, read_truth(toy)).position_m
    odometry = errors_of(result.trajectories.odometry, read_truth(toy)).position_m
    assert odometry.min() > 0.15
    assert filtered[-1] < 0.05
    assert errors_of(result.trajectories.smoothed, read_truth(toy)).position_m.max() < 0.05


def test_stamps_of_the_tracks(toy):
    session = read_session(toy)
    tracks = run(session).trajectories
    ends = session.odometry.stamps_ns[1:].tolist()
    assert tracks.odometry.stamps_ns.tolist() == [0, *ends]
    assert tracks.filtered.stamps_ns.tolist() == tracks.smoothed.stamps_ns.tolist() == ends
    assert tracks.vision.stamps_ns.tolist() == [fix.stamp_ns for fix in session.fixes]


def test_log_hears_everything_in_order(toy):
    diary = Diary()
    progress = []
    run_session(read_session(toy), CONFIG, diary, lambda done, total: progress.append((done, total)))
    assert (diary.heard[0], diary.heard[-1]) == ("begin", "finish")
    assert diary.heard.count("belief") == 160
    first = next(item for item in diary.heard if isinstance(item, tuple))
    assert diary.heard.index(first) == 7
    record, frame, outcome, window = first
    assert (frame, window) == (None, None)
    assert (record.stamp_ns, record.outcome, record.verdict, record.reason) == (
        *(330_000_000, "FIX", "FUSED", ""),
    )
    assert record.fix_x_m == outcome.belief.pose.x
    assert (record.segments, record.extract_ms, record.filename) == (None, None, "")
    assert progress == [(done, 8) for done in range(1, 9)]


def test_late_fix_is_published_late_and_recorded_with_both_times(toy):
    rows = (toy / "fixes.csv").read_text().splitlines()
    late = [f"{row},{float(row.split(',')[0]) + 0.5}" for row in rows[1:]]
    (toy / "fixes.csv").write_text("\n".join([f"{rows[0]},arrival_s", *late]) + "\n")
    diary = Diary()
    result = run(read_session(toy), diary)
    assert {record.verdict for record in result.records} == {"FUSED"}
    record = result.records[0]
    assert record.arrival_ns - record.stamp_ns == 500_000_000
    first = next(item for item in diary.heard if isinstance(item, tuple))
    assert diary.heard.index(first) == 1 + 0.83 // 0.05


def test_gross_outlier_is_rejected_and_told(toy):
    rows = (toy / "fixes.csv").read_text().splitlines()
    time, _, _, *rest = rows[4].split(",")
    rows[4] = ",".join([time, "50", "50", *rest])
    (toy / "fixes.csv").write_text("\n".join(rows) + "\n")
    records = run(read_session(toy)).records
    assert [record.verdict for record in records].count("REJECTED") == 1
    assert (records[3].verdict, records[3].reason) == ("REJECTED", "GATE")
    assert records[3].nis > 100.0


def test_a_counter_that_jumps_moves_no_track_and_is_told(toy, caplog):
    session = read_session(toy)
    straight = run(session)
    values = session.odometry.values.copy()
    values[len(values) // 2 :, 0] += 500.0
    jumped = run(dataclasses.replace(session, odometry=dataclasses.replace(session.odometry, values=values)))
    for name in ("odometry", "filtered", "smoothed"):
        away = getattr(jumped.trajectories, name).poses - getattr(straight.trajectories, name).poses
        assert np.abs(away).max() < 0.1
    assert caplog.messages == ["odometry rows that no wheels can have rolled, and not believed: 1"]


def test_frames_are_searched_in_the_window_of_their_time(two_frames):
    diary = Diary()
    result = run(two_frames, diary)
    first, second = (item for item in diary.heard if isinstance(item, tuple))
    record, frame, outcome, window = first
    assert frame is two_frames.frames[0]
    assert (record.window_dt_m, record.window_dphi_rad) == (window.dt_m, window.dphi_rad)
    assert window.centre.x == pytest.approx(record.prior_x_m)
    assert (record.filename, record.extract_ms, record.match_ms) == ("images/000000.jpg", 1.0, 2.0)
    assert (record.outcome, record.verdict) == ("FIX", "FUSED")
    assert record.sxx < outcome.belief.covariance[0, 0]
    record = second[0]
    assert (record.outcome, record.reason, record.verdict) == ("NO_FIX", "WEAK_EVIDENCE", "MISSED")
    assert record.fix_x_m is record.nis is record.fix_spp is None
    assert result.usable


def test_image_of_another_size(two_frames):
    two_frames = dataclasses.replace(
        two_frames,
        robot=dataclasses.replace(
            two_frames.robot, camera=dataclasses.replace(two_frames.camera, width=320, height=240)
        ),
    )
    with pytest.raises(InputError, match=r"000000\.jpg: 640 x 480 px, by robot\.yaml 320 x 240"):
        run(two_frames)


def with_broken(session, folder, broken):
    """Return a session of which the frames with these numbers are files that are no images."""
    path = folder / "broken.jpg"
    path.write_bytes(b"no image")
    frames = [
        dataclasses.replace(frame, path=path) if number in broken else frame
        for number, frame in enumerate(session.frames)
    ]
    return dataclasses.replace(session, frames=tuple(frames))


def test_a_broken_image_shows_nothing_and_the_run_goes_on(two_frames, tmp_path, caplog):
    session = with_broken(two_frames, tmp_path, {0})
    result = run(session)
    first, second = result.records
    assert (first.outcome, first.reason, first.verdict) == ("NO_FIX", "UNREADABLE_IMAGE", "MISSED")
    assert second.outcome == "FIX"
    assert evaluate(session, result, None)["vision"]["no_fix"] == {"UNREADABLE_IMAGE": 1}
    (warning,) = caplog.messages
    assert warning.startswith("1 images cannot be read, the first: ")
    assert "broken.jpg" in warning


def test_broken_images_alone_are_bad_input(two_frames, tmp_path):
    with pytest.raises(InputError, match=r"broken\.jpg: not an image"):
        run(with_broken(two_frames, tmp_path, {0, 1}))


def test_a_session_without_a_pose_finds_one(toy):
    """Two looks that agree; nothing is published before."""
    session = dataclasses.replace(read_session(toy), initial=None)
    result = run(session)
    tracks = result.trajectories
    assert [record.verdict for record in result.records] == ["MISSED", "RELOCALIZED", *["FUSED"] * 6]
    assert [record.reason for record in result.records[:2]] == ["UNCONFIRMED", ""]
    assert tracks.filtered.stamps_ns[0] == tracks.odometry.stamps_ns[0] == tracks.smoothed.stamps_ns[0]
    assert tracks.filtered.stamps_ns[0] == 1_350_000_000
    assert errors_of(tracks.filtered, read_truth(toy)).position_m.max() < 0.01
    states = [span.state for span in result.spans]
    assert states == ["LOST"] * 26 + ["TRACKING"] * (len(states) - 26)
    metrics = evaluate(session, result, read_truth(toy))
    assert metrics["availability"] == pytest.approx(1.0 - 1.3 / 8.0)
    assert metrics["states"] == pytest.approx({"TRACKING": 6.7, "UNCERTAIN": 0.0, "LOST": 1.3})


def test_a_position_alone_of_an_image_session_is_searched_in_all_headings(two_frames):
    unknown = PoseBelief(0, two_frames.initial.pose, np.diag([0.01, 0.01, np.inf]))
    record = run(dataclasses.replace(two_frames, initial=unknown)).records[0]
    assert record.window_dphi_rad == pytest.approx(np.pi)
    assert 0.3 < record.window_dt_m < 0.5


def test_frames_over_the_rate_are_dropped_and_counted(sample, monkeypatch):
    monkeypatch.setattr("runs.runner.LineMatcher", TrustedEye)
    session = read_session(sample)
    session = dataclasses.replace(session, frames=session.frames[:8])
    config = dataclasses.replace(CONFIG, match_rate_hz=0.4)
    progress = []
    result = run_session(session, config, NullLog(), lambda done, total: progress.append((done, total)))
    assert (len(result.records), result.dropped) == (4, 4)
    assert [record.filename for record in result.records] == [
        f"images/{number:06d}.jpg" for number in (0, 2, 4, 6)
    ]
    assert evaluate(session, result, None)["dropped_frames"] == 4
    assert run(session).dropped == 0


def test_no_heading_no_belief(toy):
    """One position-only fix tells no heading: nothing is published, and nothing breaks."""
    header = (toy / "fixes.csv").read_text().splitlines()[0]
    (toy / "fixes.csv").write_text(f"{header}\n0.33,1.0,2.0,,0.05,0.05,\n")
    session = read_session(toy)
    unknown = PoseBelief(0, session.initial.pose, np.diag([0.0025, 0.0025, np.inf]))
    result = run(dataclasses.replace(session, initial=unknown))
    assert not result.usable
    assert len(result.trajectories.filtered) == len(result.trajectories.smoothed) == 0
    assert {span.state for span in result.spans} == {"LOST"}
    assert result.records[0].outcome == "PARTIAL"
    assert result.records[0].fix_phi_rad is None


def test_run_is_the_same_without_truth(toy, tmp_path):
    folders = [tmp_path / "with", tmp_path / "without"]
    for folder in folders:
        folder.mkdir()
        run(read_session(toy), FileLog(folder))
        (toy / "ground_truth_dense.csv").unlink(missing_ok=True)
    for name in ("odometry.tum", "vision.tum", "filtered.tum", "smoothed.tum", "config.yaml"):
        with_truth, without = ((folder / name).read_bytes() for folder in folders)
        assert with_truth == without
    assert untimed(folders[0] / "steps.csv") == untimed(folders[1] / "steps.csv")


def untimed(path):
    """Return the rows of steps.csv without the columns that tell how fast the machine was."""
    rows = [line.split(",") for line in path.read_text().splitlines()]
    return [[cell for place, cell in enumerate(row) if place not in TIMING] for row in rows]


def test_steps_are_written_as_the_run_goes(toy, tmp_path):
    """A run is stopped; what it did before can be read."""
    (tmp_path / "run").mkdir()
    log = FileLog(tmp_path / "run")

    def stop(done, _total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_session(read_session(toy), CONFIG, log, stop)
    lines = (tmp_path / "run" / "steps.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == [
        *("timestamp_s", "0.330000000", "1.330000000", "2.330000000"),
    ]


def test_real_session_with_unknown_heading(data):
    """Position-only fixes and no heading to begin with: found on the way, tracks begin there."""
    folder = data / "real_odometry" / "labyrinth"
    tracks = run(read_session(folder)).trajectories
    truth = read_truth(folder)
    assert len(tracks.filtered) == len(tracks.smoothed) > 100
    assert tracks.odometry.stamps_ns[0] == tracks.filtered.stamps_ns[0] > 0
    errors = [errors_of(track, truth).position_m for track in (tracks.odometry, tracks.filtered)]
    assert np.sqrt(np.mean(errors[1] ** 2)) < np.sqrt(np.mean(errors[0] ** 2))
