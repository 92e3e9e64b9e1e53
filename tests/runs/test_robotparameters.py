"""The parameters' way from robot.yaml into a calibration and back."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from localization.odometry import OdometryNoise
from maps.errors import InputError
from runs.robot import read_robot
from runs.robotfile import with_keys
from runs.robotparameters import Doubts, names_of, prior_of, shown_value, unit_of, with_parameters, with_robot
from runs.session import read_session
from runs.templates import ROBOT

NAMES = names_of(True)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(ROBOT)
    return path


def prior(path, by_wheels=True):
    return prior_of(read_robot(path), by_wheels, Doubts(), OdometryNoise())


def test_a_files_deviation_counts_where_it_is_larger(file):
    text = with_keys(file.read_text(), ("camera", "mount"), {"std_height_m": 0.1, "std_roll_rad": 0.001})
    file.write_text(with_keys(text, ("camera", "mount"), {"std_x_m": 0.2}))
    known, stated = prior(file)
    named = dict(zip(NAMES, known.std, strict=True))
    assert (named["height_m"], named["roll_rad"], named["x_m"]) == (0.1, Doubts().tilt_rad, 0.2)
    assert stated[NAMES.index("roll_rad")] == 0.001
    assert np.isnan(stated[NAMES.index("y_m")])


def test_a_deviation_that_is_none_is_told(file):
    file.write_text(with_keys(file.read_text(), ("camera", "mount"), {"std_x_m": -1}))
    with pytest.raises(InputError, match=r"camera\.mount\.std_x_m"):
        prior(file)


def test_what_was_found_goes_into_a_copy_and_the_rest_stays(file):
    values = {"left_radius_m": 0.0501, "height_m": 1.2345678, "time_offset_s": 0.0123}
    text = with_parameters(file.read_text(), file, values, dict.fromkeys(values, 1e-9))
    out = file.with_name("out.yaml")
    out.write_text(text)
    before, after = yaml.safe_load(ROBOT), yaml.safe_load(text)
    assert after["wheels"] == before["wheels"] | {"left_radius_m": 0.0501, "std_left_radius_m": 1e-6}
    assert after["camera"]["mount"] == before["camera"]["mount"] | {
        "height_m": 1.234568,
        "std_height_m": 1e-6,
    }
    assert (after["time_offset_s"], after["std_time_offset_s"]) == (0.0123, 1e-5)
    assert all(line in text for line in ROBOT.splitlines() if line.startswith("#"))
    robot = read_robot(out)
    assert robot.time_offset_ns == 12_300_000
    assert robot.wheels.left_radius_m == 0.0501
    # Once more, nothing is there twice.
    again = with_parameters(out.read_text(), out, values, dict.fromkeys(values, 1e-9))
    assert again == text


@pytest.mark.parametrize(
    ("text", "path", "expected"),
    [
        ("a: {b: {c: 1}}\n", ("a", "b"), {"a": {"b": {"c": 1, "d": 2}}}),
        ("a:\n  b: {c: 1} # kept\n", ("a", "b"), {"a": {"b": {"c": 1, "d": 2}}}),
        ("a:\n  b:\n    c: 1\n  e: 3\n", ("a", "b"), {"a": {"b": {"c": 1, "d": 2}, "e": 3}}),
        ("a:\n  e: 3\n", ("a", "b"), {"a": {"b": {"d": 2}, "e": 3}}),
        ("e: 3\n", ("a",), {"a": {"d": 2}, "e": 3}),
        ("a:\ne: 3\n", ("a",), {"a": {"d": 2}, "e": 3}),
        ("e: 3\n", (), {"d": 2, "e": 3}),
        ("{e: 3}\n", (), {"d": 2, "e": 3}),
        ("d: 1\ne: 3\n", (), {"d": 2, "e": 3}),
        ("", ("a",), {"a": {"d": 2}}),
    ],
)
def test_keys_are_set_inside_whatever_is_there(text, path, expected):
    written = with_keys(text, path, {"d": 2})
    assert yaml.safe_load(written) == expected
    assert ("# kept" in written) == ("# kept" in text)


def test_twists_are_scaled_as_the_file_says(toy):
    odometry = "timestamp_s,forward_mps,turn_radps\n" + "".join(f"{t / 10},0.4,0.3\n" for t in range(80))
    (toy / "odometry.csv").write_text(odometry)
    robot = toy / "robot.yaml"
    robot.write_text(with_keys(robot.read_text(), ("twist",), {"forward_scale": 1.1, "turn_scale": 0.9}))
    values = read_session(toy).odometry.values
    np.testing.assert_allclose(values[0], [0.44, 0.27])
    robot.write_text(with_keys(robot.read_text(), ("twist",), {"forward_scale": 0.0}))
    with pytest.raises(InputError, match=r"twist\.forward_scale"):
        read_session(toy)


def test_a_session_of_another_robot(sample):
    session = read_session(sample)
    values = np.array([0.1, 0.01, 1.0, 0.2, 0.01, -0.01, 0.051, 0.049, 0.35, 0.25])
    other = with_robot(session, values, np.full(6, 0.03))
    assert other.odometry.wheels == other.robot.wheels
    assert (other.robot.wheels.left_radius_m, other.robot.wheels.baseline_m) == (0.051, 0.35)
    mount = other.camera.mount
    assert (mount.height_m, mount.yaw_rad, mount.std_roll_rad) == (1.0, -0.01, 0.03)
    assert other.frames[3].stamp_ns == session.frames[3].stamp_ns + 250_000_000
    assert other.frames[3].arrival_ns >= other.frames[3].stamp_ns
    assert session.camera.mount.height_m == 1.2


def test_values_for_people():
    assert [
        unit_of(name) for name in ("x_m", "turn_bias_radps", "yaw_rad", "time_offset_s", "turn_scale")
    ] == [
        "m",
        "rad/s",
        "rad",
        "s",
        "",
    ]
    assert shown_value("yaw_rad", 0.1) == "5.730 deg"
    assert shown_value("left_radius_m", 0.05) == "50.00 mm"
