"""`wireloc simulate --fault`: what goes wrong is simulated, or done to the session; the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from maps.mapfile import read_map
from runs.faults.kinds import FAULTS, corrupted, fault_span
from runs.faults.recording import read_recording
from runs.session import read_session
from runs.simulation.mishaps import band_exposure
from runs.templates import MAP, ROBOT
from vision.images import read_image

S = 10**9
SMALL = ROBOT.replace("640", "160").replace("480", "120").replace("570.0", "140.0").replace("319.5", "79.5")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("building")
    (folder / "map.yaml").write_text(MAP)
    (folder / "robot.yaml").write_text(SMALL.replace("239.5", "59.5"))
    return folder / "map.yaml", folder / "robot.yaml"


@pytest.fixture
def simulated(wireloc, files, tmp_path):
    def simulate(name, *options, seed=5):
        building, robot = files
        common = ("--robot", robot, "--out", tmp_path / name, "--seed", seed, "--seconds", 8)
        ended = wireloc("simulate", building, *common, *options)
        assert ended.code == 0, ended.err
        return tmp_path / name

    return simulate


def contents(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def pictures(folder):
    return [read_image(frame.path).astype(float) for frame in read_session(folder).frames]


def test_all_kinds_at_once_the_same_for_the_same_seed(simulated):
    options = [word for kind in FAULTS for word in ("--fault", kind)]
    one, same = contents(simulated("one", *options)), contents(simulated("same", *options))
    assert one == same
    told = yaml.safe_load(one["fault.yaml"])
    assert [fault["kind"] for fault in told] == list(FAULTS)
    assert {fault["seed"] for fault in told} == {5}


@pytest.mark.parametrize("kind", ["slip", "blocked"])
def test_wheels_that_lose_the_floor_are_those_of_the_transformation_but_for_ticks(simulated, kind):
    clean, faulty = simulated("clean", "--fixes"), simulated("faulty", "--fixes", "--fault", kind)
    recording = read_recording(clean)
    span = fault_span(recording, FAULTS[kind])
    told = yaml.safe_load((faulty / "fault.yaml").read_text())
    assert told == {"kind": kind, "seed": 5, "start_s": span.start_ns / 1e9, "end_s": span.end_ns / 1e9}
    expected = corrupted(recording, kind, span, 5).session.odometry
    found = read_session(faulty).odometry
    undone = np.abs(expected.values - recording.session.odometry.values).max()
    assert undone > 1.0
    # The true radii differ from the file's by up to 0.3 %, and more noise comes with more way.
    assert np.abs(found.values - expected.values).max() < 0.03 * undone
    assert contents(clean)["ground_truth_dense.csv"] == contents(faulty)["ground_truth_dense.csv"]


def test_a_bumped_camera_takes_other_pictures_from_then_on(simulated):
    clean, faulty = simulated("clean"), simulated("faulty", "--fault", "bumped", "--at", 4)
    recording = read_recording(clean)
    warped = corrupted(recording, "bumped", fault_span(recording, FAULTS["bumped"], 4.0), 5)
    off = list[tuple[float, float]]()
    for frame, edit, before, after in zip(
        recording.session.frames, warped.edits, pictures(clean), pictures(faulty), strict=True
    ):
        if frame.stamp_ns < 4 * S:
            np.testing.assert_array_equal(before, after)
            continue
        inner = np.s_[10:-10, 10:-10]
        turned = edit(before.astype(np.uint8)).astype(float)
        off.append((np.square(after - turned)[inner].mean(), np.square(after - before)[inner].mean()))
    assert len(off) >= 3
    by_turned, by_before = np.mean(off, axis=0)
    assert by_turned < 0.5 * by_before


def test_flickering_lamps_leave_bands_in_the_pictures(simulated):
    clean, faulty = simulated("clean"), simulated("faulty", "--fault", "rolling-exposure", "--at", 0)
    phase_rad = yaml.safe_load((faulty / "truth.yaml").read_text())["recipe"]["mishaps"]["flickers"][0][
        "phase_rad"
    ]
    for number, (before, after) in enumerate(zip(pictures(clean), pictures(faulty), strict=True)):
        told = np.log2(band_exposure(number, 120, phase_rad, 3.0))
        found = np.median(after, axis=1) / np.median(before, axis=1)
        assert np.corrcoef(told, np.log2(found))[0, 1] > 0.9


def test_the_wrong_map_can_be_that_of_any_building(simulated, wireloc, sample, tmp_path):
    other = sample / "map.yaml"
    options = ("--fault", "wrong-map", "--other-map", other)
    faulty = simulated("faulty", "--fixes", *options)
    assert len(read_map(faulty / "map.yaml")) == len(read_map(other))
    clean = simulated("clean", "--fixes")
    assert wireloc("session", "corrupt", clean, "--out", tmp_path / "corrupt", *options).code == 0
    assert (tmp_path / "corrupt" / "map.yaml").read_bytes() == (faulty / "map.yaml").read_bytes()


def test_refusals_in_one_line_before_any_picture(wireloc, files, tmp_path, monkeypatch):
    monkeypatch.setattr("runs.faults.simulating.simulate_folder", None)
    building, robot = files
    doorless = tmp_path / "doorless.yaml"
    doorless.write_text(MAP.replace("kind: door", "kind: gap"))
    out, full = tmp_path / "out", tmp_path / "full"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    for arguments, words in {
        (building, "--fault", "flood"): "flood: is none of",
        (building, "--fault", "blackout", "--fixes"): "blackout is a fault of images",
        (building, "--fault", "bumped", "--fixes"): "bumped is a fault of images",
        (building, "--fault", "slip", "--at", 99): "past the session's end",
        (building, "--fault", "slip", "--other-map", building): "--other-map",
        (building, "--fault", "wrong-map", "--other-map", tmp_path / "none.yaml"): "none.yaml: no such file",
        (doorless, "--fault", "door-moved"): "nothing of that kind",
        (building, "--fault", "slip", "--out", full): "not empty",
    }.items():
        chosen = () if "--out" in arguments else ("--out", out)
        ended = wireloc("simulate", *arguments, "--robot", robot, "--seconds", 3, *chosen)
        assert ended.code == 2, arguments
        assert words in ended.err
        assert ended.err.count("\n") == 1
        assert not out.exists()
