"""`wireloc calibrate-robot`: what it says, how it ends, and what it leaves behind."""

from __future__ import annotations

import json
import math
import shutil

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


def test_a_session_without_images_is_refused(wireloc, toy, tmp_path):
    ended = wireloc("calibrate-robot", toy, "--out", tmp_path / "out.yaml")
    assert ended.code == 2
    assert "frames.csv: no images" in ended.err
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
