"""Runs on bags: images come and go, so a longer bag takes no more memory."""

import gc
import tracemalloc

import pytest

pytest.importorskip("rosbags")

from bagtoys import drawn, info_fields, odometry_fields, raw_fields, transform, write_messages
from scipy.spatial.transform import Rotation

from maps.outcomes import NoFix, Reason
from maps.poses import Pose2
from runs.bags.topics import CAMERA_INFO, IMAGES, ODOMETRY, TRANSFORMS
from runs.config import RunConfig
from runs.opening import open_session
from runs.runlog import NullLog
from runs.runner import run_session
from vision.camera import BASE_FROM_OPTICAL
from vision.matcher import MatcherConfig

S = 10**9
HEIGHT, WIDTH = 300, 400
TOPICS = {
    "/cam/image_raw": IMAGES[0],
    "/cam/camera_info": CAMERA_INFO,
    "/odom": ODOMETRY,
    "/tf_static": TRANSFORMS[0],
}


class Blind:
    """Stands for the matcher: looks at every image, and finds nothing."""

    def __init__(self, *_):
        self.config, self.timing_ms = MatcherConfig(), {"extract": 1.0, "match": 2.0}

    def match(self, image, *_):
        assert image.shape == (HEIGHT, WIDTH)
        return NoFix(Reason.WEAK_EVIDENCE)


def bag_of(path, count):
    """Write a bag with so many raw images at 10 Hz, and as much odometry; no picture twice."""
    mount = Rotation.from_matrix(BASE_FROM_OPTICAL).as_quat()
    with_camera = {"transforms": (transform("base_link", "camera_optical", (0.2, 0.0, 0.5), mount),)}
    said = [("/tf_static", S, with_camera), ("/cam/camera_info", S, info_fields(WIDTH, HEIGHT))]
    for number in range(count + 2):
        stamp_ns = 2 * S + number * S // 10
        said.append(("/odom", stamp_ns, odometry_fields(stamp_ns, Pose2(0.001 * number, 0.0, 0.0), 0.01)))
    for number in range(count):
        stamp_ns = 2 * S + number * S // 10 + S // 20
        said.append(("/cam/image_raw", stamp_ns, raw_fields(stamp_ns, drawn(number, HEIGHT, WIDTH))))
    return write_messages(path, TOPICS, sorted(said, key=lambda message: message[1]))


def peak_of(path):
    """Return the most memory that opening and running a bag took [bytes], and how often images were looked at."""
    gc.collect()
    tracemalloc.start()
    try:
        session = open_session(path)
        result = run_session(session, RunConfig(), NullLog(), lambda *_: None)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return peak, len(result.records) + result.again.tried


def test_a_longer_bag_takes_no_more_memory(tmp_path, sample, monkeypatch):
    monkeypatch.setattr("runs.runner.LineMatcher", Blind)
    (tmp_path / "map.yaml").write_text((sample / "map.yaml").read_text())
    start = "{x_m: 2.0, y_m: 2.0, phi_rad: 0.0, std_x_m: 0.01, std_y_m: 0.01, std_phi_rad: 0.01}"
    (tmp_path / "robot.yaml").write_text(f"initial_pose: {start}\n")
    short, long = bag_of(tmp_path / "short", 12), bag_of(tmp_path / "long", 48)
    run_session(open_session(short), RunConfig(), NullLog(), lambda *_: None)
    (least, looks), (most, more_looks) = peak_of(short), peak_of(long)
    assert (looks, more_looks) == (24, 96), "each image twice: in the loop, and again at the end"
    assert most - least < 12 * HEIGHT * WIDTH, "of 36 images more"
