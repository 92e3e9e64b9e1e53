"""robot.yaml: what is read, and which key is named when it cannot be."""

import math

import numpy as np
import pytest
import yaml

from maps.errors import InputError
from runs.robot import read_robot
from vision.camera import CameraModel

DOCUMENT = """\
wheels: {radius_m: 0.05, baseline_m: 0.34, ticks_per_rev: 4096}
camera:
  model: pinhole_radtan (OpenCV)
  width: 640
  height: 480
  fx: 570.0
  fy: 571.0
  cx: 318.0
  cy: 239.0
  distortion_k1_k2_p1_p2_k3: [-0.1, 0.01, 0.001, 0.002, 0.0]
  mount: {x_m: 0.12, y_m: 0.0, height_m: 1.2, pitch_down_rad: 0.1, yaw_rad: 0, roll_rad: 0, std_yaw_rad: 0.01}
time_offset_s: -0.0125
initial_pose: {x_m: 1.0, y_m: 2.0, phi_rad: 0.5, std_x_m: 0.1, std_y_m: 0.2, std_phi_rad: 0.03}
anything: else
"""


def document():
    return yaml.safe_load(DOCUMENT)


def read(tmp_path, content):
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return read_robot(path)


def changed(key, value):
    """Return the document with `a.b` set, or removed where the value is `...`."""
    content = document()
    *parents, last = key.split(".")
    inner = content
    for parent in parents:
        inner = inner[parent]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return content


def test_everything_is_read(tmp_path):
    robot = read(tmp_path, document())
    assert (robot.wheels.left_radius_m, robot.wheels.right_radius_m) == (0.05, 0.05)
    assert robot.camera.model is CameraModel.PINHOLE_RADTAN
    assert (robot.camera.width, robot.camera.fy, robot.camera.cx) == (640, 571.0, 318.0)
    assert robot.camera.distortion.tolist() == [-0.1, 0.01, 0.001, 0.002, 0.0]
    assert (robot.camera.mount.height_m, robot.camera.mount.std_yaw_rad) == (1.2, 0.01)
    assert robot.camera.mount.std_height_m == 0.005
    assert robot.time_offset_ns == -12_500_000
    belief = robot.start.at(7)
    assert belief.stamp_ns == 7
    assert belief.pose.as_array().tolist() == [1.0, 2.0, 0.5]
    np.testing.assert_allclose(np.diag(belief.covariance), [0.01, 0.04, 0.0009])


def test_own_radii_go_before_the_nominal_one(tmp_path):
    wheels = read(tmp_path, changed("wheels.left_radius_m", 0.051)).wheels
    assert (wheels.left_radius_m, wheels.right_radius_m) == (0.051, 0.05)


def test_how_well_wheels_are_known(tmp_path):
    content = changed("wheels.std_radius_m", 0.0002)
    content["wheels"] |= {"std_left_radius_m": 0.0, "std_baseline_m": 0.004}
    wheels = read(tmp_path, content).wheels
    stds = (wheels.std_left_radius_m, wheels.std_right_radius_m, wheels.std_baseline_m)
    assert stds == (0.0, 0.0002, 0.004)
    unsaid = read(tmp_path, document()).wheels
    assert (unsaid.std_left_radius_m, unsaid.std_right_radius_m, unsaid.std_baseline_m) == (None, None, None)


def test_how_well_the_camera_is_known(tmp_path):
    content = document()
    content["camera"] |= {"std_fx": 0.57, "std_fy": 1.142, "std_cx": 0.4, "std_cy": None}
    camera = read(tmp_path, content).camera
    assert (camera.std_focal, camera.std_centre_px) == (pytest.approx(0.002), 0.4)
    unsaid = read(tmp_path, document()).camera
    assert (unsaid.std_focal, unsaid.std_centre_px) == (0.0, 0.0)


def test_fisheye(tmp_path):
    content = changed("camera.model", "fisheye (OpenCV)")
    content["camera"]["distortion_k1_k2_k3_k4"] = [0.1, 0.2, 0.3, 0.4]
    camera = read(tmp_path, content).camera
    assert camera.model is CameraModel.FISHEYE
    assert camera.distortion.tolist() == [0.1, 0.2, 0.3, 0.4]


def test_unknown_heading_is_infinitely_uncertain(tmp_path):
    belief = read(tmp_path, changed("initial_pose.phi_rad", None)).start.at(0)
    assert belief.measured.tolist() == [True, True, False]
    assert math.isinf(belief.heading_std_rad)


@pytest.mark.parametrize("key", ["wheels", "camera", "initial_pose"])
@pytest.mark.parametrize("value", [None, ...])
def test_parts_may_be_absent(tmp_path, key, value):
    robot = read(tmp_path, changed(key, value))
    assert (robot.wheels is None, robot.camera is None, robot.start is None).count(True) == 1


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("wheels.radius_m", ...),
        ("wheels.radius_m", 0.0),
        ("wheels.baseline_m", -0.3),
        ("wheels.baseline_m", math.nan),
        ("wheels.right_radius_m", math.inf),
        ("wheels.std_radius_m", -0.001),
        ("wheels.std_baseline_m", "small"),
        ("camera.std_fx", -1.0),
        ("camera.std_cy", math.inf),
        ("camera.model", "pinhole"),
        ("camera.width", 0),
        ("camera.height", 480.5),
        ("camera.fx", ...),
        ("camera.fx", 0.0),
        ("camera.fy", math.inf),
        ("camera.cx", math.nan),
        ("camera.mount", ...),
        ("camera.mount.height_m", -1.0),
        ("camera.mount.pitch_down_rad", 6.0),
        ("camera.mount.std_roll_rad", -0.1),
        ("time_offset_s", math.nan),
        ("initial_pose.x_m", "here"),
        ("initial_pose.std_x_m", 0.0),
    ],
)
def test_error_names_the_key(tmp_path, key, value):
    with pytest.raises(InputError) as error:
        read(tmp_path, changed(key, value))
    assert error.value.where == key
    assert error.value.path.endswith("robot.yaml")


@pytest.mark.parametrize("value", [..., [0.0] * 4, [0.0] * 8])
def test_distortion_must_fit_the_model(tmp_path, value):
    with pytest.raises(InputError, match="camera: distortion_k1_k2_p1_p2_k3 needs 5 numbers"):
        read(tmp_path, changed("camera.distortion_k1_k2_p1_p2_k3", value))


def test_heading_without_deviation(tmp_path):
    with pytest.raises(InputError, match="initial_pose: std_phi_rad is missing"):
        read(tmp_path, changed("initial_pose.std_phi_rad", None))
