"""`wireloc map learn`: from a run over drawn pictures to a map that says more."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from test_cli_mapcoverage import ROBOT
from toy_building import toy_building

from maps.mapfile import read_map
from maps.poses import Pose2
from runs.folder import read_tum
from runs.learning import trusted_frames
from runs.results import write_tum
from runs.runlog import COLUMNS, Trajectory
from runs.session import Frame
from vision.camera import Camera

Command = Callable[..., Any]

#: Looking at the poster, one second apart.
POSES = tuple(Pose2(5.2 + 0.15 * k, 0.6 + 0.3 * (k % 3), 1.45 - 0.1 * (k % 4)) for k in range(9))


@pytest.fixture(scope="module")
def drawn() -> list[bytes]:
    """Return the pictures as PNG files; drawing takes longest."""
    from importlib.util import module_from_spec, spec_from_file_location

    place = Path(__file__).parents[1] / "vision" / "drawing.py"
    spec = spec_from_file_location("drawing", place)
    assert spec is not None
    assert spec.loader is not None
    drawing = module_from_spec(spec)
    spec.loader.exec_module(drawing)
    camera: Camera = drawing.CAMERA
    rng = np.random.default_rng(61)
    pictures = [drawing.draw(toy_building().faces, camera, pose, rng) for pose in POSES]
    return [cv2.imencode(".png", picture)[1].tobytes() for picture in pictures]


@pytest.fixture
def drive(tmp_path: Path, drawn: list[bytes]) -> tuple[Path, Path, Path]:
    """Write a session and a run over it; return map, run and session."""
    session, run = tmp_path / "session", tmp_path / "run"
    (session / "images").mkdir(parents=True)
    run.mkdir()
    (session / "map.yaml").write_text(toy_building().text())
    (session / "robot.yaml").write_text(ROBOT)
    for number, picture in enumerate(drawn):
        (session / "images" / f"{number}.png").write_bytes(picture)
    stamps = range(len(POSES))
    write_rows(session / "frames.csv", "timestamp_s,filename", [f"{k}.0,images/{k}.png" for k in stamps])
    write_rows(
        session / "odometry.csv", "timestamp_s,forward_mps,turn_radps", [f"{k}.0,0.2,0.0" for k in stamps]
    )
    stamps_ns = np.array(stamps, np.int64) * 10**9
    write_tum(run / "smoothed.tum", Trajectory(stamps_ns, np.array([pose.as_array() for pose in POSES])))
    write_rows(run / "steps.csv", ",".join(COLUMNS), [step(k, pose) for k, pose in enumerate(POSES)])
    (run / "config.yaml").write_text(yaml.safe_dump({"run": {"session": "session", "folder": str(session)}}))
    return session / "map.yaml", run, session


def write_rows(path: Path, header: str, rows: list[str]) -> None:
    path.write_text("\n".join([header, *rows]) + "\n")


def step(second: int, pose: Pose2, verdict: str = "FUSED") -> str:
    cells = dict.fromkeys(COLUMNS, "")
    cells |= {"timestamp_s": f"{second}.0", "outcome": "FIX", "verdict": verdict}
    cells |= {"fix_x_m": f"{pose.x}", "fix_y_m": f"{pose.y}", "fix_phi_rad": f"{pose.phi}"}
    return ",".join(cells.values())


def test_a_run_teaches_the_map(wireloc: Command, drive: tuple[Path, Path, Path], tmp_path: Path) -> None:
    house, run, _ = drive
    out, plan = tmp_path / "learnt.yaml", tmp_path / "learnt.png"
    ended = wireloc("map", "learn", house, run, "--out", out, "--picture", plan, "--json")
    assert ended.code == 0, ended.err
    content = json.loads(ended.out)
    assert content["runs"] == [{"run": "run", "frames": 9, "trusted": 9, "used": 9}]
    before, after = read_map(house), read_map(out)
    assert after.names == before.names
    assert np.array_equal(after.endpoints, before.endpoints)
    poster = [after.names.index(f"poster/{edge}") for edge in ("low", "high", "left", "right")]
    assert after.polarity[poster].tolist() == [-1.0, 1.0, 1.0, -1.0]
    assert (after.detection_rate[poster] > 0.8).all()
    assert np.isnan(before.detection_rate).all()
    assert plan.read_bytes().startswith(b"\x89PNG")


def test_a_bag_teaches_what_its_folder_does(
    wireloc: Command, drive: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    house, run, session = drive
    bag = tmp_path / "drive.mcap"
    assert wireloc("session", "convert", session, bag).code == 0
    learnt = [tmp_path / "one.yaml", tmp_path / "other.yaml"]
    assert wireloc("map", "learn", house, run, "--out", learnt[0]).code == 0
    (run / "config.yaml").write_text(yaml.safe_dump({"run": {"folder": str(bag)}}))
    ended = wireloc("map", "learn", house, run, "--out", learnt[1], "--robot", session / "robot.yaml")
    assert (ended.code, ended.err) == (0, "")
    assert learnt[0].read_text() == learnt[1].read_text()


def test_the_table_names_kinds(wireloc: Command, drive: tuple[Path, Path, Path], tmp_path: Path) -> None:
    house, run, _ = drive
    ended = wireloc("map", "learn", house, run, "--out", tmp_path / "learnt.yaml")
    assert ended.code == 0
    assert "run: 9 of 9 frames" in ended.out
    assert "panel" in ended.out


def test_the_sessions_may_have_moved(
    wireloc: Command, drive: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    house, run, session = drive
    moved = session.rename(tmp_path / "elsewhere")
    house = moved / "map.yaml"
    ended = wireloc("map", "learn", house, run, "--out", tmp_path / "learnt.yaml")
    assert ended.code == 2
    assert "config.yaml: run.folder: no folder" in ended.err
    assert "--session" in ended.err
    assert not (tmp_path / "learnt.yaml").exists()
    told = wireloc("map", "learn", house, run, "--out", tmp_path / "learnt.yaml", "--session", moved)
    assert told.code == 0


def test_a_run_that_was_never_localized_teaches_nothing(
    wireloc: Command, drive: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    house, run, _ = drive
    rows = [step(k, pose, "REJECTED") for k, pose in enumerate(POSES)]
    write_rows(run / "steps.csv", ",".join(COLUMNS), rows)
    ended = wireloc("map", "learn", house, run, "--out", tmp_path / "learnt.yaml")
    assert ended.code == 1
    assert not (tmp_path / "learnt.yaml").exists()


def test_frames_are_trusted_near_fixes_that_the_track_confirms(
    drive: tuple[Path, Path, Path],
) -> None:
    _, run, session = drive
    frames = [Frame(k * 10**9, k * 10**9, f"{k}.png", session / f"{k}.png") for k in range(7)]
    off = Pose2(POSES[0].x + 0.5, POSES[0].y, POSES[0].phi)
    rows = [
        dict(zip(COLUMNS, step(k, pose).split(","), strict=True)) for k, pose in ((0, off), (6, POSES[6]))
    ]
    trusted = trusted_frames(frames, read_tum(run / "smoothed.tum"), rows)
    assert [frame.filename for frame, _ in trusted] == ["4.png", "5.png", "6.png"]
    assert all(math.isclose(pose.x, POSES[4 + k].x, abs_tol=1e-6) for k, (_, pose) in enumerate(trusted))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("run/config.yaml", "run: {session: x}\n", "config.yaml: run.folder: missing"),
        ("run/config.yaml", None, "config.yaml: no such file"),
        ("run/smoothed.tum", "1 2 3\n", "smoothed.tum: line 1"),
        ("run/steps.csv", "a,b\n", "steps.csv: line 1: no column"),
        ("session/map.yaml", "units: ft\n", "map.yaml: units"),
        ("session/images/3.png", "no picture", "3.png: not an image"),
    ],
)
def test_bad_input_is_told_in_one_line(
    wireloc: Command,
    drive: tuple[Path, Path, Path],
    tmp_path: Path,
    name: str,
    content: str | None,
    said: str,
) -> None:
    house, run, _ = drive
    (tmp_path / name).unlink()
    if content is not None:
        (tmp_path / name).write_text(content)
    ended = wireloc("map", "learn", house, run, "--out", tmp_path / "learnt.yaml")
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "learnt.yaml").exists()


def test_it_does_not_overwrite_unless_told(wireloc: Command, drive: tuple[Path, Path, Path]) -> None:
    house, run, _ = drive
    ended = wireloc("map", "learn", house, run, "--out", house)
    assert ended.code == 2
    assert "is there already; --force overwrites it" in ended.err
