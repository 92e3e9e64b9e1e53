"""Every command takes every kind of drive: a bag, its folder and other layouts give the same through each."""

import json

import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags")

from bagtoys import cut_sample
from test_layouts import as_euroc, as_tum, as_video
from toy_building import toy_building

from runs.faults.recording import read_recording
from runs.opening import Reading, open_session
from runs.session import read_session


@pytest.fixture
def cut(sample, tmp_path):
    """Return the sample with its first three frames."""
    return cut_sample(sample, tmp_path / "cut", 3)


def as_bag(wireloc, folder, place):
    """Write the bag of a folder, a single file with robot.yaml and map.yaml beside it where its name says so."""
    assert wireloc("session", "convert", folder, place).code == 0
    return place


def same_session(one, other):
    """Check that two sessions tell the same."""
    assert (one.start_ns, one.initial.pose) == (other.start_ns, other.initial.pose)
    np.testing.assert_allclose(one.odometry.values, other.odometry.values, rtol=0.0, atol=1e-9)
    for part in ("stamps_ns", "arrivals_ns"):
        assert (getattr(one.odometry, part) == getattr(other.odometry, part)).all()
    assert len(one.frames) == len(other.frames)
    for frame, again in zip(one.frames, other.frames, strict=True):
        assert (frame.stamp_ns, frame.arrival_ns) == (again.stamp_ns, again.arrival_ns)
        assert (frame.image() == again.image()).all()
    assert [(of.stamp_ns, of.arrival_ns, of.fix.belief.pose) for of in one.fixes] == pytest.approx(
        [(of.stamp_ns, of.arrival_ns, of.fix.belief.pose) for of in other.fixes]
    )


@pytest.mark.parametrize("fault", ["blackout", "doubled", "slip", "map-moved"])
def test_a_corrupted_bag_is_its_corrupted_folder(wireloc, cut, tmp_path, fault):
    options = ("--fault", fault, "--seed", "3", "--at", "0.1")
    # The bag says no more of where it began than its folder.
    bag = as_bag(wireloc, cut, tmp_path / "drive")
    for source, out in ((cut, "one"), (bag, "other")):
        ended = wireloc("session", "corrupt", source, *options, "--out", tmp_path / out)
        assert (ended.code, ended.err) == (0, "")
    one, other = read_session(tmp_path / "one"), read_session(tmp_path / "other")
    same_session(one, other)
    assert (one.wire_map.endpoints == other.wire_map.endpoints).all()
    assert (tmp_path / "other" / "ground_truth_dense.csv").exists()
    assert yaml.safe_load((tmp_path / "other" / "fault.yaml").read_text())["kind"] == fault


@pytest.mark.parametrize("make", [as_tum, as_euroc, as_video])
def test_layouts_and_videos_are_corrupted_too(wireloc, cut, tmp_path, make):
    make(cut)
    known = open_session(cut)
    ended = wireloc(
        "session", "corrupt", cut, "--fault", "whiteout", "--at", "0.6", "--out", tmp_path / "out"
    )
    assert (ended.code, ended.err) == (0, "")
    found = read_session(tmp_path / "out")
    assert [frame.stamp_ns for frame in found.frames] == [frame.stamp_ns for frame in known.frames]
    assert (found.frames[0].image() == known.frames[0].image()).all()
    assert found.frames[-1].image().mean() > 240
    assert not list((tmp_path / "out").glob("*.avi"))


def test_raw_pictures_are_written_as_files_of_their_kind(wireloc, cut, tmp_path):
    as_video(cut)
    known = read_recording(cut)
    ended = wireloc("session", "corrupt", cut, "--fault", "slip", "--at", "0.1", "--out", tmp_path / "out")
    assert ended.code == 0
    for before, after in zip(known.session.frames, read_session(tmp_path / "out").frames, strict=True):
        assert after.path.read_bytes().startswith(b"\x89PNG")
        assert (after.image() == before.image()).all()


def test_a_lone_bag_file_with_a_robot_named_for_it(wireloc, toy, tmp_path):
    (tmp_path / "lone").mkdir()
    bag = as_bag(wireloc, toy, tmp_path / "lone" / "drive.mcap")
    robot = tmp_path / "mine.yml"
    (toy / "robot.yaml").rename(robot)
    ended = wireloc("session", "corrupt", bag, "--fault", "slip", "--out", tmp_path / "out", "--robot", robot)
    assert (ended.code, ended.err) == (0, "")
    assert (tmp_path / "out" / "robot.yaml").read_text() == robot.read_text()
    assert read_session(tmp_path / "out").robot.wheels == open_session(bag, Reading(None, robot)).robot.wheels


def figures(said):
    """Return a sweep's rows without times and names."""
    return [
        {name: of for name, of in row.items() if name not in ("seconds", "fix_ms", "session")}
        for row in json.loads(said)
    ]


def test_a_sweep_of_a_bag_is_that_of_its_folder(wireloc, toy, tmp_path):
    pytest.importorskip("pyarrow")
    bag = as_bag(wireloc, toy, tmp_path / "bag")
    options = ("--faults", "none,slip", "--workers", "1", "--json")
    one = wireloc("sweep", toy, *options, "--out", tmp_path / "one")
    other = wireloc("sweep", bag, *options, "--out", tmp_path / "other", "--robot", toy / "robot.yaml")
    assert (one.code, other.code) == (0, 0)
    for row, again in zip(figures(one.out), figures(other.out), strict=True):
        assert row.keys() == again.keys()
        for name, value in row.items():
            assert again[name] == (pytest.approx(value, abs=1e-6) if isinstance(value, float) else value), (
                name
            )


def test_a_session_study_of_a_bag_is_that_of_its_folder(wireloc, cut, tmp_path):
    bag = as_bag(wireloc, cut, tmp_path / "bag")
    options = ("--images", "2", "--methods", "default", "--json")
    one = wireloc("experiment", "session", cut, *options, "--out", tmp_path / "one")
    other = wireloc("experiment", "session", bag, *options, "--out", tmp_path / "other")
    assert (one.code, other.code) == (0, 0), other.err
    rows = [json.loads(of.out)["rows"] for of in (one, other)]
    for row in (*rows[0], *rows[1]):
        del row["ms"], row["filename"]
    assert rows[0] == rows[1]


def test_what_cannot_be_is_told_in_a_line(wireloc, toy, tmp_path):
    bag = as_bag(wireloc, toy, tmp_path / "drive.mcap")
    (tmp_path / "robot.yaml").write_text((toy / "robot.yaml").read_text())
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.yaml").write_text(f"run: {{folder: '{tmp_path / 'gone.bag'}'}}\n")
    house = tmp_path / "house.yaml"
    house.write_text(toy_building().text())

    def told(*arguments):
        ended = wireloc(*arguments)
        assert (ended.code, ended.err.count("\n")) == (2, 1), (arguments, ended.err)
        return ended.err

    out = ("--out", tmp_path / "out")
    assert "drive.mcap: no images" in told("calibrate-robot", bag, "--out", tmp_path / "out.yaml")
    assert "drive.mcap: no images" in told("experiment", "session", bag, *out)
    assert "no topic /odom" in told(
        "session", "corrupt", bag, "--fault", "slip", *out, "--topic", "odometry=/odom"
    )
    assert "fault of images" in told("session", "corrupt", bag, "--fault", "blur", *out)
    assert "ROLE=TOPIC" in told("sweep", bag, *out, "--topic", "camera")
    assert "LEFT,RIGHT" in told("calibrate-robot", bag, "--out", tmp_path / "out.yaml", "--joints", "left")
    assert "is for bags" in told("session", "corrupt", toy, "--fault", "slip", *out, "--joints", "a,b")
    assert "gone.bag: name the session" in told("map", "learn", house, tmp_path / "run", *out)
    learnt = told("map", "learn", house, tmp_path / "run", *out, "--session", bag)
    assert "drive.mcap: no images to learn from" in learnt
    (toy / "rgb.txt").write_text("0.5 a.png\n")
    assert "is for bags" in told("run", toy, *out, "--topic", "image=/camera")
    assert not (tmp_path / "out").exists()
