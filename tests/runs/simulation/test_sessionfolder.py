"""`wireloc simulate`: folders that read back and run, the same for the same seed; refusals in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runs.config import RunConfig
from runs.evaluation import read_truth
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import read_session
from runs.templates import MAP, ROBOT
from runs.tracks import errors_of
from tests.conftest import Command
from vision.images import read_image

SMALL = ROBOT.replace("640", "160").replace("480", "120").replace("570.0", "140.0").replace("319.5", "79.5")


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    building, robot = tmp_path / "map.yaml", tmp_path / "robot.yaml"
    building.write_text(MAP)
    robot.write_text(SMALL.replace("239.5", "59.5"))
    return building, robot


def test_fixes_read_back_and_run(wireloc: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    building, robot = files
    out = tmp_path / "session"
    ended = wireloc("simulate", building, "--robot", robot, "--out", out, "--fixes", "--seconds", 15)
    assert ended.code == 0, ended.err
    assert ended.out.strip() == str(out)
    session = read_session(out)
    assert (len(session.fixes), len(session.frames)) == (15, 0)
    assert not (out.with_name("session.partial")).exists()
    truth = read_truth(out)
    assert truth is not None
    assert len(truth) == 751
    assert session.initial is not None
    off = session.initial.pose.as_array() - truth.poses[0]
    assert 0.0 < np.hypot(off[0], off[1]) < 0.25
    result = run_session(session, RunConfig(), NullLog(), lambda *_: None)
    assert np.median(errors_of(result.trajectories.filtered, truth).position_m) < 0.1


def test_images_read_back_at_their_poses(wireloc: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    building, robot = files
    out = tmp_path / "session"
    options = ("--seconds", 3, "--frame-rate", 2, "--twist", "--seed", 4)
    ended = wireloc("simulate", building, "--robot", robot, "--out", out, *options)
    assert ended.code == 0, ended.err
    session = read_session(out)
    assert session.odometry.wheels is None
    assert session.wire_map is not None
    assert len(session.frames) in (5, 6)
    assert read_image(session.frames[0].path).shape == (120, 160)
    rows = (out / "ground_truth.csv").read_text().splitlines()
    assert len(rows) == len(session.frames) + 1
    observable = (out / "observable.csv").read_text().splitlines()
    assert observable[0] == "filename,visible,observable"
    assert [row.split(",")[0] for row in observable[1:]] == [frame.filename for frame in session.frames]
    assert any(int(row.split(",")[1]) > 0 for row in observable[1:])
    assert (out / "robot.yaml").read_text().startswith("# The robot.")


def test_the_seed_decides_and_images_leave_the_drive_alone(
    wireloc: Command, files: tuple[Path, Path], tmp_path: Path
) -> None:
    building, robot = files
    told = {}
    for name, options in {
        "one": ("--seed", 5),
        "same": ("--seed", 5),
        "fixes": ("--seed", 5, "--fixes", "--frame-rate", 0),
        "other": ("--seed", 6),
    }.items():
        common = ("--robot", robot, "--out", tmp_path / name, "--seconds", 2)
        assert wireloc("simulate", building, *common, *options).code == 0
        files_of = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        told[name] = {path.relative_to(tmp_path / name): path.read_bytes() for path in files_of}
    assert told["one"] == told["same"]
    dense, odometry = Path("ground_truth_dense.csv"), Path("odometry.csv")
    assert told["one"][odometry] != told["other"][odometry]
    assert told["one"][dense] == told["fixes"][dense]
    assert told["one"][odometry] == told["fixes"][odometry]


def test_an_uncalibrated_clock_is_off_and_the_file_does_not_say(
    wireloc: Command, files: tuple[Path, Path], tmp_path: Path
) -> None:
    building, robot = files
    outs = {name: tmp_path / name for name in ("exact", "uncalibrated")}
    for name, out in outs.items():
        options = ("--calibration", name, "--seconds", 2, "--seed", 3)
        assert wireloc("simulate", building, "--robot", robot, "--out", out, *options).code == 0
    exact, off = (read_session(out) for out in outs.values())
    assert off.robot.time_offset_ns == exact.robot.time_offset_ns == 0
    late_ns = off.frames[0].stamp_ns - exact.frames[0].stamp_ns
    assert 1_000_000 < abs(late_ns) < 50_000_000
    assert "time_offset_s" in (outs["uncalibrated"] / "truth.yaml").read_text()


def test_refusals_in_one_line(wireloc: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    building, robot = files
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    blind = tmp_path / "blind.yaml"
    blind.write_text("wheels: {radius_m: 0.05, baseline_m: 0.3}\n")
    legless = tmp_path / "legless.yaml"
    legless.write_text(SMALL.split("wheels:")[0] + "camera:" + SMALL.split("camera:")[1])
    narrow = tmp_path / "narrow.yaml"
    narrow.write_text(
        "segments: [{p0: [0, 0, 0], p1: [5, 0, 0]}]\nfloor: [{outer: [[0, 0], [5, 0], [5, 0.3], [0, 0.3]]}]\n"
    )
    out = tmp_path / "out"
    for arguments, words in {
        (building, "--out", full): "not empty",
        (building, "--out", out, "--robot", blind): "blind.yaml: camera",
        (building, "--out", out, "--robot", legless): "wheels",
        (narrow, "--out", out): "narrow.yaml: floor: no room",
        (tmp_path / "none.yaml", "--out", out): "none.yaml: no such file",
        (building, "--out", out, "--frame-rate", 0): "nothing to localize with",
    }.items():
        options = () if "--robot" in arguments else ("--robot", robot)
        ended = wireloc("simulate", *arguments, *options)
        assert ended.code == 2, arguments
        assert words in ended.err
        assert ended.err.count("\n") == 1
        assert not out.exists()
    assert (full / "mine.txt").read_text() == "mine"
