"""Bags with pictures at 25 Hz: looks counted, those over the rate not read, old ones dropped on a live robot."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

from dataclasses import replace

from bagtoys import write_table

from runs.bags.images import BagPicture
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.opening import open_session
from runs.runlog import NullLog
from runs.runner import run_session

RATE_HZ, COUNT = 25, 25


@pytest.fixture
def bag(sample, tmp_path, wireloc):
    """Return a bag of a robot that stands for a second where the sample's first picture was taken."""
    folder = tmp_path / "standing"
    (folder / "images").mkdir(parents=True)
    for name in ("robot.yaml", "map.yaml"):
        shutil.copy(sample / name, folder / name)
    rows = (sample / "frames.csv").read_text().splitlines()
    first_s, name = rows[1].split(",")
    truth = (sample / "ground_truth_dense.csv").read_text().splitlines()
    x, y, phi = next(row for row in truth[1:] if float(row.split(",")[0]) >= float(first_s)).split(",")[1:]
    start = f"initial_pose: {{x_m: {x}, y_m: {y}, phi_rad: {phi}, std_x_m: 0.05, std_y_m: 0.05, std_phi_rad: 0.03}}\n"
    robot = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(robot[: robot.index("initial_pose:")] + start)
    frames = []
    for number in range(COUNT):
        shutil.copy(sample / name, folder / "images" / f"{number}.jpg")
        stamp_s = number / RATE_HZ
        frames.append(f"{stamp_s:.4f},images/{number}.jpg,{stamp_s + 0.02:.4f}")
    write_table(folder / "frames.csv", "timestamp_s,filename,arrival_s", frames)
    times = np.arange(0.0, COUNT / RATE_HZ + 0.1, 0.02)
    write_table(
        folder / "odometry.csv",
        "timestamp_s,left_wheel_rad,right_wheel_rad",
        [f"{at:.4f},0,0" for at in times],
    )
    write_table(
        folder / "ground_truth_dense.csv",
        "timestamp_s,x_m,y_m,phi_rad",
        [f"{at:.4f},{x},{y},{phi}" for at in times],
    )
    assert wireloc("session", "convert", folder, tmp_path / "bag").code == 0
    return tmp_path / "bag"


@pytest.fixture
def opened(monkeypatch):
    """Collect the pictures that are read."""
    read = []
    before = BagPicture.read

    def counting(self):
        read.append(self.stamp_ns)
        return before(self)

    monkeypatch.setattr(BagPicture, "read", counting)
    return read


@pytest.mark.parametrize(("rate_hz", "looks"), [(None, COUNT), (5.0, 5)])
def test_looks_and_dropped_frames_add_up(bag, opened, rate_hz, looks):
    session = open_session(bag)
    second_pass = replace(RunConfig().second_pass, enabled=False)
    config = replace(RunConfig(), match_rate_hz=rate_hz, second_pass=second_pass)
    result = run_session(session, config, NullLog(), lambda *_: None)
    metrics = evaluate(session, result, read_truth(bag))
    assert (metrics["frames"], metrics["dropped_frames"]) == (COUNT, COUNT - looks)
    assert (len(result.records), metrics["vision"]["attempted"]) == (looks, looks)
    assert sorted(set(opened)) == [record.stamp_ns for record in result.records]
    assert metrics["vision"]["wrong"] == metrics["vision"]["rejected"] == 0
    assert metrics["vision"]["accepted"] == looks
    assert metrics["filtered"]["position_error_m"]["max"] < 0.06
    if rate_hz is not None:
        apart = np.diff([record.stamp_ns for record in result.records]) / 1e9
        assert apart.mean() == pytest.approx(1.0 / rate_hz, abs=0.5 / RATE_HZ)


def test_a_live_robot_keeps_up_by_dropping(bag):
    place = Path(__file__).resolve().parents[2] / "docs" / "examples" / "live.py"
    spec = importlib.util.spec_from_file_location("live_example", place)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    seen = []
    example.tell = seen.append
    live = example.main(bag, speed=1.0, told=True)
    assert len(seen) + live.dropped == COUNT
    assert len(seen) >= 1
    assert [of.stamp_ns for of in seen] == sorted(of.stamp_ns for of in seen), "newer ones only"
    true = read_truth(bag).poses[0]
    assert np.hypot(*(live.belief.pose.as_array() - true)[:2]) < 0.06
