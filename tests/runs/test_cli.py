"""The command line, end to end: what it says, how it ends, and what it leaves behind."""

import json
import shutil

import numpy as np
import pytest

pytest.importorskip("runs.report")

TRACKS = ("odometry", "vision", "filtered", "smoothed")


def left_behind(folder):
    """Return what a command wrote beside the session."""
    return sorted(path.name for path in folder.iterdir() if path.name not in ("toy", "pictures"))


def test_help_and_version(wireloc):
    shown = wireloc("--help")
    assert shown.code == 0
    assert "run" in shown.out
    assert "compare" in shown.out
    assert wireloc("--version").out.startswith("wireloc 0.")


def test_run_writes_a_whole_folder(wireloc, toy, tmp_path):
    out = tmp_path / "out"
    ended = wireloc("run", toy, "--out", out)
    assert (ended.code, ended.err) == (0, "")
    for word in ("odometry", "raw vision", "filtered", "smoothed", "8 accepted, 0 rejected, 0 wrong"):
        assert word in ended.out
    assert ended.out.splitlines()[-2:] == [str(out), f"wireloc view {out}"]
    names = {path.name for path in out.iterdir()}
    files = {"run.rrd", "steps.csv", "metrics.json", "report.html", "config.yaml", "truth.tum"}
    assert files | {f"{track}.tum" for track in TRACKS} <= names
    assert json.loads((out / "metrics.json").read_text())["filtered"]["position_error_m"]["max"] < 0.01
    assert np.loadtxt(out / "filtered.tum").shape == (160, 8)
    assert left_behind(tmp_path) == ["out"]


def test_default_folder_and_latest(wireloc, toy, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert wireloc("run", toy).code == 0
    latest = tmp_path / "results" / "latest"
    assert latest.resolve().name.startswith("toy-")
    assert (latest / "metrics.json").exists()


def test_without_truth(wireloc, toy, tmp_path):
    (toy / "ground_truth_dense.csv").unlink()
    ended = wireloc("run", toy, "--out", tmp_path / "out")
    assert ended.code == 0
    assert "no ground truth" in ended.out
    assert "8 accepted, 0 rejected\n" in ended.out
    assert not (tmp_path / "out" / "truth.tum").exists()


def test_pose_from_the_command_line(wireloc, toy, tmp_path):
    (toy / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.4}\n")
    out = tmp_path / "out"
    options = ("--initial-pose", "1.1,2.0,0.45", "--initial-std", "0.2,6")
    assert wireloc("run", toy, "--out", out, *options).code == 0
    first = np.loadtxt(out / "odometry.tum")[0]
    np.testing.assert_allclose(first[1:3], [1.1, 2.0])
    assert "std_x_m: 0.2\n" in (out / "config.yaml").read_text()


def test_nothing_accepted_ends_with_one(wireloc, toy, tmp_path):
    # Far off and sure of it: the gate refuses the fixes, and there are too few for them to win.
    fixes = (toy / "fixes.csv").read_text().splitlines()
    (toy / "fixes.csv").write_text("\n".join(fixes[:3]) + "\n")
    options = ("--initial-pose", "-40,7,0.5", "--initial-std", "0.05,1")
    ended = wireloc("run", toy, "--out", tmp_path / "out", *options)
    assert ended.code == 1
    assert ended.err.count("\n") == 1
    assert (tmp_path / "out" / "metrics.json").exists()


def test_fixes_that_agree_correct_a_wrong_start(wireloc, toy, tmp_path):
    options = ("--initial-pose", "-40,7,0.5", "--initial-std", "0.05,1")
    ended = wireloc("run", toy, "--out", tmp_path / "out", *options)
    assert ended.code == 0
    assert "RELOCALIZED" in (tmp_path / "out" / "steps.csv").read_text()


def test_compare(wireloc, toy, tmp_path):
    out = tmp_path / "out"
    wireloc("run", toy, "--out", out)
    ended = wireloc("compare", out, "--out", tmp_path / "compared")
    assert ended.code == 0
    assert "smoothed" in ended.out
    assert str(tmp_path / "compared") in ended.out


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("odometry.csv", None, "odometry.csv: no such file"),
        ("odometry.csv", "", "odometry.csv: no rows"),
        (
            "odometry.csv",
            "timestamp_s,left_wheel_rad,right_wheel_rad\n0,0,0\n1,x,0\n",
            "odometry.csv: line 3",
        ),
        (
            "odometry.csv",
            "timestamp_s,left_wheel_rad,right_wheel_rad\n0,0,0\n0,1,0\n",
            "odometry.csv: line 3",
        ),
        ("odometry.csv", "timestamp_s,left_wheel_rad\n0,0\n1,0\n", "odometry.csv: line 1"),
        ("fixes.csv", None, "neither frames.csv nor fixes.csv"),
        ("fixes.csv", "timestamp_s,x_m\n0,1\n", "fixes.csv: line 1: no column"),
        ("robot.yaml", None, "robot.yaml: no such file"),
        ("robot.yaml", "wheels: [", "robot.yaml: line"),
        ("robot.yaml", "wheels: {radius_m: -1, baseline_m: 1}", "robot.yaml: wheels.radius_m"),
        ("map.yaml", "units: feet\nsegments: []\nfloor: []\n", "map.yaml: units"),
        ("frames.csv", "timestamp_s,filename\n0,../x.jpg\n", "frames.csv: line 2"),
        (
            "ground_truth_dense.csv",
            "timestamp_s,x_m,y_m,phi_rad\n0,0,0,a\n",
            "ground_truth_dense.csv: line 2",
        ),
    ],
)
def test_bad_input(wireloc, toy, tmp_path, name, text, said):
    if text is None:
        (toy / name).unlink()
    else:
        (toy / name).write_text(text)
    ended = wireloc("run", toy, "--out", tmp_path / "out")
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert ended.out == ""
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--initial-pose", "1"), "--initial-pose: expected X,Y[,PHI]"),
        (("--initial-pose", "1,nan"), "--initial-pose: expected X,Y[,PHI]"),
        (("--initial-pose", "1,2,3", "--initial-std", "1"), "--initial-std: expected DT_M,DPHI_DEG"),
        (("--initial-pose", "1,2,3", "--initial-std", "0,1"), "--initial-std: not above zero"),
        (("--initial-std", "1,1"), "--initial-std: says nothing without --initial-pose"),
        (("--config", "nowhere.yaml"), "nowhere.yaml: no such file"),
        (("--map", "nowhere.yaml"), "nowhere.yaml: no such file"),
    ],
)
def test_bad_options(wireloc, toy, tmp_path, options, said):
    ended = wireloc("run", toy, "--out", tmp_path / "out", *options)
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert left_behind(tmp_path) == []


def test_unknown_parameter(wireloc, toy, tmp_path):
    (toy / "mine.yaml").write_text("localizer: {gait: 1}\n")
    ended = wireloc("run", toy, "--config", toy / "mine.yaml", "--out", tmp_path / "out")
    assert ended.code == 2
    assert "mine.yaml: localizer.gait: " in ended.err


def test_existing_results_are_kept(wireloc, toy, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("kept")
    ended = wireloc("run", toy, "--out", tmp_path / "out")
    assert ended.code == 2
    assert "is not empty" in ended.err
    assert (tmp_path / "out" / "precious").read_text() == "kept"


def test_listed_image_that_is_none(wireloc, sample, tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("robot.yaml", "map.yaml", "odometry.csv"):
        shutil.copyfile(sample / name, folder / name)
    (folder / "frames.csv").write_text("timestamp_s,filename\n0.2,image.jpg\n")
    (folder / "image.jpg").write_text("a poem")
    ended = wireloc("run", folder, "--out", tmp_path / "out")
    assert ended.code == 2
    assert "image.jpg: not an image" in ended.err
    assert ended.err.count("\n") == 1
    assert left_behind(tmp_path) == []


def test_run_without_a_pose(wireloc, toy, tmp_path):
    """Told to forget it, or never told: two looks that agree, and the run goes on from there."""
    ended = wireloc("run", toy, "--lost", "--out", tmp_path / "lost")
    assert ended.code == 0
    (toy / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.4}\n")
    ended = wireloc("run", toy, "--out", tmp_path / "unknown")
    assert ended.code == 0
    for name in ("filtered.tum", "odometry.tum", "smoothed.tum", "vision.tum"):
        tracks = [(tmp_path / run / name).read_text() for run in ("lost", "unknown")]
        assert tracks[0] == tracks[1] != ""
    assert (tmp_path / "lost" / "filtered.tum").read_text().startswith("1.35")


def test_never_found_is_no_usable_result(wireloc, toy, tmp_path):
    rows = (toy / "fixes.csv").read_text().splitlines()
    (toy / "fixes.csv").write_text("\n".join(rows[:2]) + "\n")
    ended = wireloc("run", toy, "--lost", "--out", tmp_path / "out")
    assert ended.code == 1
    assert "no fix was accepted" in ended.err
    assert (tmp_path / "out" / "filtered.tum").read_text() == ""
