"""Sessions as bags and back: the same runs, results as MCAP, damaged bags."""

import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from bagtoys import KINDS, cut_sample, write_table
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader

from maps.poses import Pose2
from runs.bags.mounting import rotation_of
from runs.bags.wheels import heading
from runs.config import RunConfig
from runs.folder import read_steps, read_tum, to_ns
from runs.opening import Reading, open_session
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import read_session


def ran(path, reading=None):
    """Run a session, and return its result."""
    return run_session(open_session(path, reading), RunConfig(), NullLog(), lambda *_: None)


def same_run(one, other, tolerance=1e-9):
    """Check that two results are the same but for what they cost in time."""
    for name, track in one.trajectories.by_name().items():
        again = other.trajectories.by_name()[name]
        assert (track.stamps_ns == again.stamps_ns).all()
        np.testing.assert_allclose(track.poses, again.poses, rtol=0.0, atol=tolerance)
    for record, again in zip(one.records, other.records, strict=True):
        assert (record.stamp_ns, record.arrival_ns, record.state) == (
            again.stamp_ns,
            again.arrival_ns,
            again.state,
        )
        assert (record.outcome, record.reason, record.verdict) == (again.outcome, again.reason, again.verdict)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_and_its_folder_give_the_same_run(wireloc, toy, tmp_path, kind):
    name, options = KINDS[kind]
    assert wireloc("session", "convert", toy, tmp_path / name, *options).code == 0
    one, other = ran(toy), ran(tmp_path / name, Reading(robot_path=toy / "robot.yaml"))
    assert one.usable
    same_run(one, other)


def test_late_and_twisted(wireloc, toy, tmp_path):
    first, *rows = (toy / "odometry.csv").read_text().splitlines()
    assert first.startswith("timestamp_s,left")
    times = [row.split(",")[0] for row in rows]
    twists = [f"{at},{0.4 + 0.001 * row},0.3,{float(at) + 0.02}" for row, at in enumerate(times)]
    write_table(toy / "odometry.csv", "timestamp_s,forward_mps,turn_radps,arrival_s", twists)
    first, *rows = (toy / "fixes.csv").read_text().splitlines()
    late = [[*row.split(","), f"{float(row.split(',')[0]) + 0.6}"] for row in rows]
    late[2][3] = late[2][6] = ""
    write_table(toy / "fixes.csv", f"{first},arrival_s", [",".join(row) for row in late])
    assert wireloc("session", "convert", toy, tmp_path / "bag").code == 0
    assert wireloc("session", "convert", tmp_path / "bag", tmp_path / "back").code == 0
    one = ran(toy)
    assert one.usable
    for name in ("bag", "back"):
        # Headings go through quaternions; where the smoother stops iterating hangs on the last digit.
        same_run(one, ran(tmp_path / name), 1e-6)
    assert (tmp_path / "back" / "ground_truth_dense.csv").exists()


def test_images_there_and_back(wireloc, sample, tmp_path):
    folder = cut_sample(sample, tmp_path / "cut")
    robot = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(f"{robot}time_offset_s: 0.012\n")
    assert wireloc("session", "convert", folder, tmp_path / "bag").code == 0
    assert wireloc("session", "convert", tmp_path / "bag", tmp_path / "back").code == 0
    assert (tmp_path / "back" / "robot.yaml").read_text() == (folder / "robot.yaml").read_text()
    known, found, back = read_session(folder), open_session(tmp_path / "bag"), read_session(tmp_path / "back")
    for session in (found, back):
        assert (session.odometry.values == known.odometry.values).all()
        for one, other in zip(known.frames, session.frames, strict=True):
            assert (one.stamp_ns, one.arrival_ns, one.data()) == (
                other.stamp_ns,
                other.arrival_ns,
                other.data(),
            )
    assert [frame.filename for frame in found.frames] == [frame.filename for frame in back.frames]
    # Where robot.yaml is lost, the messages know the camera as well.
    (tmp_path / "bag" / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    camera, mount = open_session(tmp_path / "bag").camera, known.camera.mount
    assert (camera.fx, camera.cx, camera.width) == (known.camera.fx, known.camera.cx, known.camera.width)
    np.testing.assert_allclose(
        [camera.mount.x_m, camera.mount.height_m, camera.mount.pitch_down_rad, camera.mount.yaw_rad],
        [mount.x_m, mount.height_m, mount.pitch_down_rad, mount.yaw_rad],
        atol=1e-12,
    )


def test_a_run_on_pictures(wireloc, sample, tmp_path):
    folder, out = cut_sample(sample, tmp_path / "cut", 2), tmp_path / "out"
    assert wireloc("session", "convert", folder, tmp_path / "bag").code == 0
    assert wireloc("run", tmp_path / "bag", "--out", out).code == 0
    result = ran(folder)
    assert result.usable
    for name, track in result.trajectories.by_name().items():
        written = read_tum(out / f"{name}.tum")
        assert (written.stamps_ns == track.stamps_ns).all()
        np.testing.assert_allclose(written.poses, track.poses, atol=2e-9)
    assert (out / "report.html").read_text().count("data:image/jpeg") >= 2, "the worst frames' pictures"
    chunks = RrdReader(out / "run.rrd").stream().to_chunks()
    pictures = [chunk for chunk in chunks if str(chunk.entity_path) == "/world/robot/camera/image"]
    assert sum(chunk.num_rows for chunk in pictures) >= 2


def read_messages(path):
    """Return a bag's messages by topic, each with its receive stamp."""
    said = {}
    with AnyReader([path]) as reader:
        for connection, at_ns, raw in reader.messages():
            said.setdefault(connection.topic, []).append((at_ns, reader.deserialize(raw, connection.msgtype)))
    return said


def beliefs_of(told, frame):
    """Return stamps (N,), poses (N, 3) and covariances (N, 3, 3) of messages with poses, in a frame."""
    rows, known = [], np.array([0, 1, 5])
    for at_ns, message in told:
        stamp = message.header.stamp
        assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (at_ns, frame)
        pose = message.pose.pose
        assert pose.position.z == 0.0
        whole = message.pose.covariance.reshape(6, 6)
        assert np.count_nonzero(whole) == np.count_nonzero(whole[np.ix_(known, known)])
        at = (pose.position.x, pose.position.y, heading(pose.orientation))
        rows.append((at_ns, at, whole[np.ix_(known, known)]))
    return [np.array(part) for part in zip(*rows, strict=True)]


@pytest.mark.parametrize("lost", [False, True])
def test_results_as_mcap(wireloc, toy, tmp_path, lost):
    out, options = tmp_path / "out", ("--log", "off", "--mcap", *(("--lost",) if lost else ()))
    assert wireloc("run", toy, "--out", out, *options).code == 0
    said = read_messages(out / "run.mcap")
    # The same run again: what files do not tell, its result does.
    session = open_session(toy)
    session = replace(session, initial=None) if lost else session
    tracks = run_session(session, RunConfig(), NullLog(), lambda *_: None).trajectories
    told = {
        "/wireloc/pose": tracks.filtered,
        "/wireloc/fix": tracks.vision,
        "/wireloc/smoothed": tracks.smoothed,
    }
    for topic, track in told.items():
        stamps_ns, poses, covariances = beliefs_of(said[topic], "map")
        assert len(track) > 5
        assert (stamps_ns == track.stamps_ns).all()
        np.testing.assert_allclose(poses, track.poses, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(covariances, track.covariances, rtol=1e-9, atol=0.0)
    places = {}
    for at_ns, message in said["/tf"]:
        for one in message.transforms:
            shift, turn = one.transform.translation, heading(one.transform.rotation)
            places[at_ns, one.header.frame_id, one.child_frame_id] = Pose2(shift.x, shift.y, turn)
    filtered, odometry = read_tum(out / "filtered.tum"), read_tum(out / "odometry.tum")
    for at_ns, pose in zip(filtered.stamps_ns.tolist(), filtered.poses, strict=True):
        chain = places[at_ns, "map", "odom"] @ places[at_ns, "odom", "base_footprint"]
        np.testing.assert_allclose(chain.as_array(), pose, atol=1e-8)
    corrected = {at_ns for at_ns, parent, _ in places if parent == "map"}
    assert corrected == set(filtered.stamps_ns.tolist()), "nowhere while lost"
    stamps_ns, poses, _ = beliefs_of(said["/odom"], "odom")
    assert (stamps_ns == odometry.stamps_ns).all()
    np.testing.assert_allclose(poses, odometry.poses, atol=1e-8)
    check_diagnostics(said["/diagnostics"], read_steps(out))


def check_diagnostics(said, steps):
    """Check that the diagnostics tell what steps.csv tells, row by row."""
    assert len(said) == len(steps) == 8
    levels = {"TRACKING": 0, "UNCERTAIN": 1, "LOST": 2}
    for (at_ns, message), step in zip(said, steps, strict=True):
        (status,) = message.status
        words = (step["state"], step["outcome"], step["reason"], step["verdict"])
        assert status.message == " ".join(word for word in words if word)
        assert (status.level, at_ns) == (levels[step["state"]], to_ns(step["timestamp_s"]))
        values = {value.key: value.value for value in status.values}
        assert values.get("nis", "") == step["nis"]
        assert values["outcome"] == step["outcome"]


def test_results_tell_where_the_camera_sits(wireloc, sample, tmp_path):
    folder = cut_sample(sample, tmp_path / "cut", 1)
    assert wireloc("run", folder, "--out", tmp_path / "out", "--log", "off", "--mcap").code in (0, 1)
    ((_, message),) = read_messages(tmp_path / "out" / "run.mcap")["/tf_static"]
    (told,) = message.transforms
    mount = read_session(folder).camera.mount
    place, turn = told.transform.translation, told.transform.rotation
    assert (told.header.frame_id, place.x, place.y, place.z) == (
        "base_footprint",
        mount.x_m,
        mount.y_m,
        mount.height_m,
    )
    # The optical axis looks ahead, and down by the pitch.
    axis = rotation_of((turn.x, turn.y, turn.z, turn.w))[:, 2]
    np.testing.assert_allclose(
        axis, [np.cos(mount.pitch_down_rad), 0.0, -np.sin(mount.pitch_down_rad)], atol=1e-9
    )


@pytest.mark.parametrize("kind", ["mcap file", "sqlite3 file", "ros1 file"])
def test_damaged_bags_are_told_in_a_line(wireloc, toy, tmp_path, kind):
    name, _ = KINDS[kind]
    assert wireloc("session", "convert", toy, tmp_path / name).code == 0
    whole = (tmp_path / name).read_bytes()
    rng = np.random.default_rng(7)
    damaged = [whole[: int(len(whole) * share)] for share in (0.0, 0.001, 0.3, 0.9, 0.999)]
    for _ in range(8):
        content = bytearray(whole)
        for place in rng.integers(0, len(whole), 40):
            content[place] = rng.integers(256)
        damaged.append(bytes(content))
    refused = 0
    for number, content in enumerate(damaged):
        path = tmp_path / f"{number}{(tmp_path / name).suffix}"
        path.write_bytes(content)
        ended = wireloc("session", "convert", path, tmp_path / f"out {number}", "--robot", toy / "robot.yaml")
        assert ended.code in (0, 2)
        if ended.code == 2:
            refused += 1
            assert len([line for line in ended.err.splitlines() if path.name in line]) == 1
            assert not (tmp_path / f"out {number}").exists()
    assert refused >= 5


def test_bad_input(wireloc, toy, tmp_path):
    bag, refused = tmp_path / "bag", []

    def told(*arguments):
        ended = wireloc(*arguments)
        assert ended.code == 2, arguments
        assert ended.err.count("\n") == 1
        refused.append(ended.err)
        return ended.err

    assert wireloc("session", "convert", toy, bag).code == 0
    assert "is there already" in told("session", "convert", toy, bag)
    assert "is a bag already" in told("session", "convert", bag, tmp_path / "x.bag")
    assert "mcap or sqlite3" in told("session", "convert", toy, tmp_path / "x", "--storage", "tape")
    assert ".bag says it already" in told("session", "convert", toy, tmp_path / "x.bag", "--storage", "mcap")
    assert "says nothing" in told("session", "convert", bag, tmp_path / "x", "--storage", "mcap")
    assert "no such file" in told("run", tmp_path / "none.bag")
    assert "no such file" in told("session", "topics", tmp_path / "none")
    assert "a folder with tables, not a bag" in told("session", "topics", toy)
    assert "ROLE=TOPIC" in told("run", bag, "--topic", "picture=/cam")
    assert "LEFT,RIGHT" in told("run", bag, "--joints", "wheel")
    assert "is for bags" in told("run", toy, "--robot", toy / "robot.yaml")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: 3\n")
    assert "not a bag that can be read" in told("run", bag)
    (bag / "metadata.yaml").unlink()
    assert wireloc("run", bag, "--out", tmp_path / "x", "--log", "off").code == 0
    shutil.copy(bag / "bag.mcap", bag / "second.mcap")
    assert "several bag files" in told("run", bag)


def test_times_before_zero(wireloc, toy, tmp_path):
    text = (toy / "odometry.csv").read_text().splitlines()
    (toy / "odometry.csv").write_text("\n".join([text[0], "-1.0,0,0", *text[2:]]) + "\n")
    ended = wireloc("session", "convert", toy, tmp_path / "bag")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert "before zero" in ended.err
    assert "before zero" in wireloc("run", toy, "--out", tmp_path / "out", "--log", "off", "--mcap").err
    assert not (tmp_path / "out").exists()


def test_without_rosbags(wireloc, toy, tmp_path, monkeypatch):
    (tmp_path / "drive.bag").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    asked = (
        ("run", tmp_path / "drive.bag"),
        ("session", "topics", tmp_path / "drive.bag"),
        ("session", "convert", toy, tmp_path / "x"),
        ("run", toy, "--out", tmp_path / "out", "--mcap"),
    )
    for arguments in asked:
        ended = wireloc(*arguments)
        assert (ended.code, ended.err) == (2, "wireloc: bags need rosbags: pip install 'wireloc[bags]'\n")
    assert not (tmp_path / "out").exists()
