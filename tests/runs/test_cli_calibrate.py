"""`wireloc calibrate`, end to end: what it says, how it ends, and what it leaves behind."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import yaml
from boardviews import BARREL, draw_board, poses

from runs.camerainfo import read_camera_info
from runs.robot import read_robot
from runs.templates import ROBOT
from vision.boards import Charuco, Chessboard

BOARD = Chessboard(7, 5, 0.03)
OPTIONS = ("--board", "7x5", "--square", "0.03")


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("views")
    rng = np.random.default_rng(7)
    for index, pose in enumerate(poses(BARREL, BOARD, 8, rng)):
        assert cv2.imwrite(str(folder / f"view{index}.png"), draw_board(BARREL, BOARD, pose, rng))
    return sorted(folder.iterdir())


def test_a_calibration_goes_into_the_robot_file_and_nothing_else_changes(wireloc, pictures, tmp_path):
    out = tmp_path / "robot.yaml"
    out.write_text(ROBOT)
    info = tmp_path / "camera_info.yaml"
    ended = wireloc("calibrate", *pictures, *OPTIONS, "--out", out, "--camera-info", info)
    assert (ended.code, ended.err) == (0, "")
    drawing = tmp_path / "robot_calibration.png"
    assert ended.out.splitlines()[-3:] == [str(out), str(info), str(drawing)]
    assert all(str(path) in ended.out for path in pictures)
    for word in ("8 views, 0 left out", "standard deviation", "k3"):
        assert word in ended.out
    assert cv2.imread(str(drawing)) is not None
    camera = read_robot(out).camera
    assert (camera.width, camera.height, camera.mount.height_m) == (320, 240, 1.2)
    assert camera.fx == pytest.approx(BARREL.fx, abs=2.0)
    assert 0.0 < yaml.safe_load(out.read_text())["camera"]["std_fx"] < 2.0
    assert "# where the camera sits" in out.read_text()
    np.testing.assert_allclose(read_camera_info(info).matrix, camera.matrix, atol=1e-3)


def test_a_copy_of_another_robot_file(wireloc, pictures, tmp_path):
    robot, out = tmp_path / "robot.yaml", tmp_path / "calibrated.yaml"
    robot.write_text(ROBOT)
    assert wireloc("calibrate", *pictures, *OPTIONS, "--robot", robot, "--out", out).code == 0
    assert robot.read_text() == ROBOT
    assert read_robot(out).wheels == read_robot(robot).wheels
    ended = wireloc("calibrate", *pictures, *OPTIONS, "--robot", robot, "--out", out)
    assert ended.code == 2
    assert "is there already" in ended.err


def test_a_new_robot_file_says_what_it_lacks(wireloc, pictures, tmp_path):
    out = tmp_path / "robot.yaml"
    ended = wireloc("calibrate", *pictures, *OPTIONS, "--out", out)
    assert ended.code == 0
    assert "mount is left for you" in ended.out
    assert "# mount:" in out.read_text()


def test_for_programs(wireloc, pictures):
    broken = pictures[0].with_name("broken.jpg")
    broken.write_text("no picture")
    ended = wireloc("calibrate", *pictures, broken, *OPTIONS, "--json")
    content = json.loads(ended.out)
    assert content["calibrated"]
    assert content["rms_px"] < 0.2
    assert content["camera"]["model"] == "pinhole_radtan (OpenCV)"
    assert [view["corners"] for view in content["views"]] == [35] * 8
    assert content["rejected"] == {str(broken): "not an image that can be read"}


def test_a_camera_from_ros(wireloc, pictures, tmp_path):
    info, out, other = tmp_path / "ci.yaml", tmp_path / "robot.yaml", tmp_path / "back.yaml"
    assert wireloc("calibrate", *pictures, *OPTIONS, "--camera-info", info).code == 0
    out.write_text(ROBOT)
    ended = wireloc("calibrate", "--from-camera-info", info, "--out", out, "--camera-info", other)
    assert (ended.code, ended.out.splitlines()) == (0, [str(out), str(other)])
    np.testing.assert_allclose(read_robot(out).camera.matrix, read_camera_info(info).matrix, atol=1e-3)
    np.testing.assert_array_equal(read_camera_info(other).matrix, read_camera_info(info).matrix)


def test_charuco_and_fisheye(wireloc, tmp_path):
    board, rng = Charuco(5, 4, 0.04, 0.03, "4X4_50"), np.random.default_rng(3)
    for index, pose in enumerate(poses(BARREL, board, 8, rng)):
        assert cv2.imwrite(str(tmp_path / f"{index}.png"), draw_board(BARREL, board, pose, rng))
    options = ("--board", "5x4", "--square", "0.04", "--charuco", "DICT_4x4_50", "--marker", "0.03")
    ended = wireloc("calibrate", *sorted(tmp_path.glob("*.png")), *options, "--model", "fisheye", "--json")
    assert ended.code == 0
    camera = json.loads(ended.out)["camera"]
    assert camera["model"] == "fisheye (OpenCV)"
    assert camera["fx"] == pytest.approx(BARREL.fx, rel=0.03)


def test_images_without_the_board_end_with_one_and_leave_nothing(wireloc, pictures, tmp_path):
    out = tmp_path / "robot.yaml"
    ended = wireloc("calibrate", *pictures, "--board", "8x6", "--square", "0.03", "--out", out)
    assert ended.code == 1
    assert ended.out.count("board not found") == 8
    assert "usable views: 0" in ended.err
    assert "inner corners" in ended.err
    assert ended.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_odd_images_are_named_and_left_out(wireloc, pictures, tmp_path):
    odd = {
        "dot.png": np.zeros((1, 1), np.uint8),
        "white.png": np.full((240, 320), 255, np.uint8),
        "large.png": np.zeros((300, 400), np.uint8),
        "deep.png": np.zeros((240, 320), np.uint16),
        "clear.png": np.zeros((240, 320, 4), np.uint8),
    }
    for name, image in odd.items():
        assert cv2.imwrite(str(tmp_path / name), image)
    half = tmp_path / "half.png"
    half.write_bytes(pictures[0].read_bytes()[:2000])
    ended = wireloc("calibrate", *pictures, *sorted(tmp_path.iterdir()), *OPTIONS)
    assert ended.code == 0
    assert "8 views, 6 left out" in ended.out
    assert ended.out.count("not of the other images' size") == 2
    assert ended.out.count("board not found") == 3
    assert ended.out.count("not an image that can be read") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "calibrate: needs images"),
        (("{image}", "--board", "7x5"), "calibrate: needs images"),
        (("none.png", *OPTIONS), "none.png: no such file"),
        (("{image}", "--board", "7by5", "--square", "1"), "--board: expected COLSxROWS"),
        (("{image}", "--board", "2x5", "--square", "1"), "--board: expected COLSxROWS"),
        (("{image}", "--board", "7x5", "--square", "0"), "--square: expected metres"),
        (("{image}", "--board", "7x5", "--square", "nan"), "--square: expected metres"),
        (("{image}", *OPTIONS, "--marker", "0.01"), "--marker: says nothing"),
        (("{image}", *OPTIONS, "--charuco", "9X9_1"), "--charuco: '9X9_1' is none of"),
        (("{image}", *OPTIONS, "--charuco", "4X4_50"), "--marker: expected metres"),
        (("{image}", *OPTIONS, "--charuco", "4X4_50", "--marker", "0.04"), "--marker: expected metres"),
        (
            ("{image}", "--board", "20x20", "--square", "1", "--charuco", "4X4_50", "--marker", "0.5"),
            "too few markers",
        ),
        (("{image}", *OPTIONS, "--robot", "robot.yaml"), "--robot: says nothing without --out"),
        (("{image}", *OPTIONS, "--picture", "a.gif"), "--picture: expected .png"),
        (("{image}", *OPTIONS, "--out", "{image}"), "not UTF-8 text"),
        (("--from-camera-info", "none.yaml"), "--from-camera-info: goes with --out"),
        (("--from-camera-info", "none.yaml", "--out", "robot.yaml"), "none.yaml: no such file"),
    ],
)
def test_bad_input(wireloc, pictures, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    ended = wireloc("calibrate", *(str(option).format(image=pictures[0]) for option in options))
    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_parameters_from_a_file(wireloc, pictures, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("fit: {square_pixels: true}\ncorners: {window_px: 4}\n")
    content = json.loads(wireloc("calibrate", *pictures, *OPTIONS, "--config", config, "--json").out)
    assert content["camera"]["fx"] == content["camera"]["fy"]
    config.write_text("fit: {square: true}\n")
    ended = wireloc("calibrate", *pictures, *OPTIONS, "--config", config)
    assert (ended.code, "config.yaml: fit.square" in ended.err) == (2, True)


def test_a_session_runs_with_a_camera_from_ros(wireloc, sample, tmp_path):
    info, out = tmp_path / "ci.yaml", tmp_path / "robot.yaml"
    from runs.camerainfo import write_camera_info

    camera = read_robot(sample / "robot.yaml").camera
    write_camera_info(info, camera)
    ended = wireloc("calibrate", "--from-camera-info", info, "--robot", sample / "robot.yaml", "--out", out)
    assert ended.code == 0
    back = read_robot(out)
    np.testing.assert_allclose(back.camera.matrix, camera.matrix, atol=1e-4)
    assert (back.camera.mount, back.wheels, back.start) == (
        camera.mount, read_robot(sample / "robot.yaml").wheels, read_robot(sample / "robot.yaml").start,
    )  # fmt: skip
