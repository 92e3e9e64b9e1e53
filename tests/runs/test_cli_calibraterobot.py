"""`wireloc calibrate-robot`: what it says, how it ends, and what it leaves behind."""

from __future__ import annotations

import json
import math
import shutil
from itertools import pairwise

import pytest
import yaml

from runs.robot import read_robot
from runs.robotparameters import names_of

#: A drive short enough for a test: its first frames, one run.
FRAMES, QUICK = 16, "runs: 1\ntilt: {frames: 6}\nsolve: {spread_rounds: 2}\n"


@pytest.fixture(scope="module")
def short(sample, tmp_path_factory):
    """The first seconds of the bundled session, the camera's pitch in the file half a degree off."""
    folder = tmp_path_factory.mktemp("short")
    for name in ("map.yaml", "robot.yaml"):
        shutil.copyfile(sample / name, folder / name)
    (folder / "images").symlink_to(sample / "images")
    rows = (sample / "frames.csv").read_text().splitlines()[: FRAMES + 1]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    last_s = float(rows[-1].split(",")[0])
    header, *odometry = (sample / "odometry.csv").read_text().splitlines()
    kept = [row for row in odometry if float(row.split(",")[0]) < last_s + 0.5]
    (folder / "odometry.csv").write_text("\n".join([header, *kept]) + "\n")
    robot = (folder / "robot.yaml").read_text()
    pitch = yaml.safe_load(robot)["camera"]["mount"]["pitch_down_rad"]
    off = f"pitch_down_rad: {pitch + math.radians(0.5)} # by eye"
    (folder / "robot.yaml").write_text(robot.replace(f"pitch_down_rad: {pitch}", off))
    (folder / "quick.yaml").write_text(QUICK)
    return folder


def test_a_drive_puts_the_camera_right_and_says_what_it_does_not_show(wireloc, short, sample, tmp_path):
    out = tmp_path / "robot.yaml"
    ended = wireloc("calibrate-robot", short, "--out", out, "--config", short / "quick.yaml")
    assert (ended.code, ended.err) == (0, "")
    said = ended.out.splitlines()
    assert said[-1] == str(out)
    for name in names_of(True):
        (row,) = (line for line in said if line.strip().startswith(name))
        assert row.rstrip().endswith("shown")
    true, found = read_robot(sample / "robot.yaml").camera.mount, read_robot(out).camera.mount
    assert abs(found.pitch_down_rad - true.pitch_down_rad) < math.radians(0.1)
    assert found.std_pitch_down_rad < math.radians(0.1)
    assert "# by eye" in out.read_text()
    before, after = (yaml.safe_load((folder / "robot.yaml").read_text()) for folder in (short, tmp_path))
    assert after["initial_pose"] == before["initial_pose"]
    assert after["camera"]["fx"] == before["camera"]["fx"]


def test_a_bag_calibrates_as_its_folder_does(wireloc, short, tmp_path):
    pytest.importorskip("rosbags")
    bag = tmp_path / "bag"
    assert wireloc("session", "convert", short, bag).code == 0
    for source, out in ((short, "one.yaml"), (bag, "other.yaml")):
        ended = wireloc("calibrate-robot", source, "--out", tmp_path / out, "--config", short / "quick.yaml")
        assert (ended.code, ended.err) == (0, "")
    assert (tmp_path / "one.yaml").read_text() == (tmp_path / "other.yaml").read_text()


def test_without_a_robot_file_a_whole_one_is_written(wireloc, short, sample, tmp_path):
    pytest.importorskip("rosbags")
    twists = tmp_path / "twists"
    shutil.copytree(short, twists, symlinks=True)
    rows = [row.split(",") for row in (short / "odometry.csv").read_text().splitlines()[1:]]
    wheels = yaml.safe_load((short / "robot.yaml").read_text())["wheels"]
    table = ["timestamp_s,forward_mps,turn_radps"]
    for (at, *before), (then, *after) in pairwise(rows):
        left, right = (
            (float(now) - float(was)) * wheels["radius_m"] / (float(then) - float(at))
            for now, was in zip(after, before, strict=True)
        )
        table.append(f"{at},{0.5 * (left + right)},{(right - left) / wheels['baseline_m']}")
    (twists / "odometry.csv").write_text("\n".join(table) + "\n")
    bag, out = tmp_path / "bag", tmp_path / "robot.yaml"
    assert wireloc("session", "convert", twists, bag).code == 0
    (bag / "robot.yaml").unlink()
    ended = wireloc("calibrate-robot", bag, "--out", out, "--config", short / "quick.yaml")
    assert (ended.code, ended.err) == (0, "")
    camera, true = read_robot(out).camera, read_robot(sample / "robot.yaml").camera
    assert (camera.fx, camera.width) == (true.fx, true.width)
    assert abs(camera.mount.pitch_down_rad - true.mount.pitch_down_rad) < math.radians(0.15)
    assert "initial_pose" not in out.read_text(), "where one drive began is nothing of the robot's"


def test_a_session_without_images_is_refused(wireloc, toy, tmp_path):
    ended = wireloc("calibrate-robot", toy, "--out", tmp_path / "out.yaml")
    assert ended.code == 2
    assert "toy: no images" in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not (tmp_path / "out.yaml").exists()


def test_parameters_that_nobody_knows_and_folders_that_are_not_there_are_refused(wireloc, short, tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("noise: {swaying: 1}\n")
    ended = wireloc("calibrate-robot", short, "--out", tmp_path / "out.yaml", "--config", wrong)
    assert ended.code == 2
    assert "noise.swaying" in ended.err
    ended = wireloc("calibrate-robot", short, "--out", tmp_path / "nowhere" / "out.yaml")
    assert ended.code == 2
    assert "no such folder" in ended.err


def test_a_drive_of_few_frames_ends_with_a_reason(wireloc, short, tmp_path):
    folder = tmp_path / "few"
    shutil.copytree(short, folder, symlinks=True)
    rows = (short / "frames.csv").read_text().splitlines()[:4]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path / "out.yaml"
    ended = wireloc("calibrate-robot", folder, "--out", out, "--json", "--config", short / "quick.yaml")
    assert ended.code == 1
    told = json.loads(ended.out)
    assert told["calibrated"] is False
    assert "frames match the map" in told["why"]
    assert not out.exists()
