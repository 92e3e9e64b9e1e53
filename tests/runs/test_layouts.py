"""Other projects' folders, and videos, as sessions: the same frames as the images that they were made from."""

import shutil

import cv2
import numpy as np
import pytest

from maps.errors import InputError
from runs.layouts import is_layout
from runs.opening import Reading, open_session
from runs.session import read_session
from vision.images import read_image

SENSOR = """\
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -0.19866933, 0.98006658, 0.3, -1.0, 0.0, 0.0, 0.05, 0.0, -0.98006658, -0.19866933, 0.9, 0, 0, 0, 1]
rate_hz: 20
resolution: [640, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""


@pytest.fixture
def cut(sample, tmp_path):
    """Return the sample with its first four frames."""
    folder = tmp_path / "cut"
    (folder / "images").mkdir(parents=True)
    for name in ("robot.yaml", "map.yaml", "odometry.csv"):
        shutil.copy(sample / name, folder / name)
    rows = (sample / "frames.csv").read_text().splitlines()[:5]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    for row in rows[1:]:
        shutil.copy(sample / row.split(",")[1], folder / row.split(",")[1])
    return folder


def rows_of(folder):
    return [row.split(",")[:2] for row in (folder / "frames.csv").read_text().splitlines()[1:]]


def as_tum(folder):
    """Turn the cut sample into TUM's layout."""
    rows = [f"{stamp} {name}" for stamp, name in rows_of(folder)]
    (folder / "rgb.txt").write_text("\n".join(["# color images", "# timestamp filename", *rows]) + "\n")
    (folder / "frames.csv").unlink()
    return folder


def as_euroc(folder):
    """Turn the cut sample into EuRoC's layout."""
    camera = folder / "mav0" / "cam0"
    (camera / "data").mkdir(parents=True)
    rows = []
    for stamp, name in rows_of(folder):
        stamp_ns = round(float(stamp) * 1e9)
        shutil.move(folder / name, camera / "data" / f"{stamp_ns}.jpg")
        rows.append(f"{stamp_ns},{stamp_ns}.jpg")
    (camera / "data.csv").write_text("\r\n".join(["#timestamp [ns],filename", *rows]) + "\r\n")
    (camera / "sensor.yaml").write_text(SENSOR)
    (folder / "frames.csv").unlink()
    return folder


def as_video(folder, codec="MJPG"):
    """Turn the cut sample into a video with its stamps."""
    rows = rows_of(folder)
    images = [read_image(folder / name) for _, name in rows]
    height, width = images[0].shape
    writer = cv2.VideoWriter(str(folder / "drive.avi"), cv2.VideoWriter_fourcc(*codec), 20.0, (width, height))
    assert writer.isOpened()
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    (folder / "frames.csv").write_text("\n".join(["timestamp_s", *(stamp for stamp, _ in rows)]) + "\n")
    shutil.rmtree(folder / "images")
    return folder


def told(session):
    return [(frame.stamp_ns, frame.arrival_ns) for frame in session.frames]


@pytest.mark.parametrize("make", [as_tum, as_euroc])
def test_layouts_have_the_same_frames(cut, make, tmp_path, wireloc):
    known = read_session(cut)
    images = [frame.image() for frame in known.frames]
    assert not is_layout(cut)
    found = open_session(make(cut))
    assert is_layout(cut)
    assert told(found) == told(known)
    assert all((frame.image() == image).all() for frame, image in zip(found.frames, images, strict=True))
    assert found.camera.fx == known.camera.fx
    assert wireloc("session", "convert", cut, tmp_path / "back").code == 0
    back = read_session(tmp_path / "back")
    assert told(back) == told(known)
    assert (back.odometry.values == known.odometry.values).all()
    assert (back.frames[-1].image() == images[-1]).all()


def test_sensor_yaml_where_robot_yaml_has_no_camera(cut):
    (cut / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    camera = open_session(as_euroc(cut)).camera
    assert (camera.fx, camera.cy, camera.width) == (458.654, 248.375, 640)
    assert camera.distortion.tolist() == [-0.28, 0.07, 0.0002, 0.00002, 0.0]
    mount = camera.mount
    found = (mount.x_m, mount.y_m, mount.height_m, mount.pitch_down_rad, mount.yaw_rad, mount.roll_rad)
    np.testing.assert_allclose(found, (0.3, 0.05, 0.9, 0.2, 0.0, 0.0), atol=1e-7)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("0.2 ../../etc/passwd", "line 1"),
        ("0.2", "line 1"),
        ("soon images/000000.jpg", "line 1"),
        ("nan images/000000.jpg", "line 1"),
        ("0.2 images/none.jpg", "no such file"),
        ("0.2 images/000000.jpg\n0.2 images/000001.jpg", "line 2: stamps do not rise"),
        ("# nothing", "no rows"),
    ],
)
def test_bad_tables(cut, text, what):
    (as_tum(cut) / "rgb.txt").write_text(text + "\n")
    with pytest.raises(InputError, match=what) as refused:
        open_session(cut)
    assert "rgb.txt" in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("pinhole", "omni", "camera_model"),
        ("[458.654, 457.296, ", "[", "intrinsics"),
        ("458.654", "-458.654", "intrinsics"),
        ("0.98006658, 0.3", "0.5, 0.3", "T_BS: no rotation"),
        ("-0.19866933, 0.9,", "-0.19866933, -0.9,", "T_BS: is -0.90 m above the floor"),
    ],
)
def test_bad_sensors(cut, old, new, what):
    (cut / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    (as_euroc(cut) / "mav0" / "cam0" / "sensor.yaml").write_text(SENSOR.replace(old, new))
    with pytest.raises(InputError, match=what):
        open_session(cut)


def test_a_video_has_the_same_frames(cut, tmp_path, wireloc):
    known = read_session(cut)
    images = [frame.image() for frame in known.frames]
    found = open_session(as_video(cut))
    assert told(found) == told(known)
    for number in (0, 1, 3, 1, 0, 2):
        away = found.frames[number].image().astype(float) - images[number]
        # The video is compressed once more.
        assert np.abs(away).mean() < 4.0
        wrong = found.frames[number].image().astype(float) - images[number - 1]
        assert np.abs(wrong).mean() > 2.0 * np.abs(away).mean()
    assert wireloc("session", "convert", cut, tmp_path / "bag").code == 0
    assert (open_session(tmp_path / "bag").frames[2].image() == found.frames[2].image()).all()


def test_bad_videos(cut):
    (as_video(cut) / "frames.csv").write_text("timestamp_s\n" + "".join(f"{row}.0\n" for row in range(9)))
    with pytest.raises(InputError, match=r"9 stamps for the 4 frames of drive\.avi"):
        open_session(cut)
    (cut / "drive.avi").write_bytes((cut / "drive.avi").read_bytes()[:300])
    with pytest.raises(InputError, match=r"drive\.avi"):
        open_session(cut).frames[0].image()
    (cut / "drive.avi").unlink()
    with pytest.raises(InputError, match="no column filename, and no video"):
        open_session(cut)


def test_options_of_bags_are_for_bags(cut):
    with pytest.raises(InputError, match="--robot"):
        open_session(cut, Reading(robot_path=cut / "robot.yaml"))
