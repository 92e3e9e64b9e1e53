"""Bags as sessions: topics, stamps, the camera and its mounting, the start."""

import json
import math
import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags")

from bagtoys import (
    drawn,
    info_fields,
    odometry_fields,
    raw_fields,
    transform,
    write_messages,
)

from maps.errors import InputError
from maps.poses import Pose2
from runs.bags.bagfile import BagKind, covariance_fields, header, pose_fields
from runs.bags.topics import CAMERA_INFO, IMAGES, JOINTS, ODOMETRY, POSE, TRANSFORMS, Role, Wanted
from runs.opening import Reading, open_session
from vision.camera import BASE_FROM_OPTICAL

S = 10**9
TOPICS = {
    "/cam/image_raw": IMAGES[0],
    "/cam/camera_info": CAMERA_INFO,
    "/odom": ODOMETRY,
    "/tf_static": TRANSFORMS[0],
}
#: A camera 0.3 m ahead of base_link, looking 0.2 rad down and 0.1 to the left, on a mast of two transforms.
MOUNT = (Rotation.from_euler("ZYX", [0.1, 0.2, 0.05]) * Rotation.from_matrix(BASE_FROM_OPTICAL)).as_quat()
STATIC = (
    transform("base_footprint", "base_link", (0.0, 0.0, 0.1)),
    transform("base_link", "mast", (0.3, 0.05, 0.5)),
    transform("mast", "camera_optical", (0.0, 0.0, 0.4), MOUNT),
)
NOWHERE = transform("mast", "camera_optical", (0.0, 0.0, 0.4), (0.0, 0.0, 0.0, math.inf))


def straight(seconds=4, hz=10, start_s=100.0):
    """Yield odometry of a robot that drives straight at 0.5 m/s, received 10 ms later."""
    for count in range(seconds * hz + 1):
        stamp_ns = round((start_s + count / hz) * S)
        yield "/odom", stamp_ns + S // 100, odometry_fields(stamp_ns, Pose2(0.5 * count / hz, 0.0, 0.0), 0.5)


def pictures(topic="/cam/image_raw", count=3, delay_ns=S // 10):
    """Yield images, one a second, received 0.1 s later."""
    for number in range(count):
        stamp_ns = (101 + number) * S
        yield topic, stamp_ns + delay_ns, raw_fields(stamp_ns, drawn(number))


@pytest.fixture(autouse=True)
def map_file(tmp_path, sample):
    (tmp_path / "map.yaml").write_text((sample / "map.yaml").read_text())
    return tmp_path / "map.yaml"


def messages(*more):
    static = ("/tf_static", 100 * S, {"transforms": STATIC})
    return [static, ("/cam/camera_info", 100 * S, info_fields()), *straight(), *pictures(), *more]


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a", BagKind.MCAP), ("b", BagKind.SQLITE3), ("c.bag", BagKind.ROS1), ("d.mcap", BagKind.MCAP)],
)
def test_a_bag_alone_is_a_session(tmp_path, map_file, name, kind):
    session = open_session(write_messages(tmp_path / name, TOPICS, messages(), kind))
    assert session.map_path == map_file or session.map_path == map_file.resolve()
    assert (session.name, len(session.frames), session.start_ns, session.initial) == (
        name[0],
        3,
        100 * S,
        None,
    )
    assert [frame.stamp_ns for frame in session.frames] == [101 * S, 102 * S, 103 * S]
    assert [frame.arrival_ns - frame.stamp_ns for frame in session.frames] == [S // 10] * 3
    for number in (0, 2, 1, 0):
        assert (session.frames[number].image() == drawn(number)).all()
    camera, odometry = session.camera, session.odometry
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (20.0, 21.0, 7.5, 5.5)
    assert camera.distortion.tolist() == [0.1, -0.02, 0.001, 0.002, 0.0]
    found = [
        getattr(camera.mount, key)
        for key in ("x_m", "y_m", "height_m", "pitch_down_rad", "yaw_rad", "roll_rad")
    ]
    np.testing.assert_allclose(found, [0.3, 0.05, 1.0, 0.2, 0.1, 0.05], atol=1e-9)
    np.testing.assert_allclose(odometry.values[:-1], np.tile([0.5, 0.0], (40, 1)), atol=1e-6)
    assert (odometry.arrivals_ns - odometry.stamps_ns == S // 100).all()


def test_rectified_images_have_the_lens_of_their_projection(tmp_path):
    topics = {
        "/cam/image_rect": IMAGES[0],
        **{name: kind for name, kind in TOPICS.items() if "raw" not in name},
    }
    said = [(topic.replace("image_raw", "image_rect"), at, fields) for topic, at, fields in messages()]
    camera = open_session(write_messages(tmp_path / "bag", topics, said)).camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (19.0, 19.5, 7.0, 5.0)
    assert not camera.distortion.any()


def test_several_topics_that_fit_must_be_chosen(tmp_path, wireloc):
    topics = TOPICS | {
        "/rear/image_raw": IMAGES[0],
        "/depth/image_raw": IMAGES[0],
        "/cam/image_raw/compressed": IMAGES[1],
    }
    said = messages(*pictures("/rear/image_raw", 2), *pictures("/depth/image_raw", 2))
    bag = write_messages(tmp_path / "bag", topics, said)
    with pytest.raises(
        InputError, match="several topics fit image: /cam/image_raw, /rear/image_raw; name one with"
    ):
        open_session(bag)
    rear = open_session(bag, Reading(wanted=Wanted({Role.IMAGE: "/rear/image_raw"})))
    assert len(rear.frames) == 2
    ended = wireloc("session", "topics", bag, "--json")
    told = json.loads(ended.out)
    assert "several topics fit image" in told["open"]
    ended = wireloc("session", "topics", bag, "--json", "--topic", "image=/cam/image_raw")
    told = json.loads(ended.out)
    assert told["open"] is None
    uses = {row["topic"]: row["use"] for row in told["topics"]}
    assert uses["/cam/image_raw"] == "image"
    assert uses["/cam/camera_info"] == "info"
    assert uses["/odom"] == "odometry"
    assert uses["/tf_static"] == "transforms"
    assert uses["/rear/image_raw"] is None
    assert wireloc("session", "topics", bag).code == 0


@pytest.mark.parametrize(
    ("asked", "what"),
    [
        ({Role.IMAGE: "/nowhere"}, "no topic /nowhere"),
        ({Role.IMAGE: "/odom"}, "/odom is no Image or CompressedImage"),
        ({Role.START: "/odom"}, "/odom is no PoseWithCovarianceStamped"),
    ],
)
def test_topics_that_are_not_there(tmp_path, asked, what):
    bag = write_messages(tmp_path / "bag", TOPICS, messages())
    with pytest.raises(InputError, match=what):
        open_session(bag, Reading(wanted=Wanted(asked)))


def test_what_robot_yaml_says_is_not_asked_of_the_bag(tmp_path, sample):
    bag = write_messages(tmp_path / "bag", TOPICS, messages())
    session = open_session(bag, Reading(robot_path=sample / "robot.yaml"))
    assert session.camera.fx == 570.0
    assert session.odometry.wheels is None


def test_stamps_repeated_or_out_of_order(tmp_path, caplog):
    said = messages()
    said.append(said[10])
    moved = [(topic, 200 * S - at if topic == "/odom" else at, fields) for topic, at, fields in said]
    ordered = open_session(write_messages(tmp_path / "a", TOPICS, messages()))
    shuffled = open_session(write_messages(tmp_path / "b", TOPICS, moved))
    assert (ordered.odometry.stamps_ns == shuffled.odometry.stamps_ns).all()
    assert (ordered.odometry.values == shuffled.odometry.values).all()
    assert "1 messages repeat a stamp" in caplog.text


def test_without_stamps_received_counts(tmp_path, caplog):
    said = [
        (topic, at, {**fields, "header": header(0, "")} if topic == "/odom" else fields)
        for topic, at, fields in messages()
    ]
    session = open_session(write_messages(tmp_path / "bag", TOPICS, said))
    assert session.start_ns == 100 * S + S // 100
    assert "/odom has no stamps" in caplog.text


def initial(stamp_ns, pose, deviations, topic="/initialpose"):
    known = {"pose": pose_fields(pose), "covariance": covariance_fields(np.diag(np.square(deviations)))}
    return topic, stamp_ns, {"header": header(stamp_ns, "map"), "pose": known}


def test_the_start_is_taken_back_to_the_first_event(tmp_path):
    said = messages(initial(102 * S, Pose2(5.0, 6.0, math.pi / 2), (0.1, 0.2, 0.05)))
    session = open_session(write_messages(tmp_path / "bag", TOPICS | {"/initialpose": POSE}, said))
    assert session.initial.stamp_ns == session.start_ns == 100 * S
    np.testing.assert_allclose(session.initial.pose.as_array(), [5.0, 5.0, math.pi / 2], atol=1e-6)
    deviations = np.sqrt(np.diag(session.initial.covariance))
    np.testing.assert_allclose(deviations, [math.hypot(0.1, 0.05), 0.2, 0.05], atol=1e-6)


def test_estimates_of_other_programs_are_not_read(tmp_path):
    said = messages(initial(100 * S, Pose2(5.0, 6.0, 0.0), (0.1, 0.1, 0.1), "/amcl_pose"))
    bag = write_messages(tmp_path / "bag", TOPICS | {"/amcl_pose": POSE}, said)
    assert open_session(bag).initial is None
    assert open_session(bag, Reading(wanted=Wanted({Role.START: "/amcl_pose"}))).initial.pose.x == 5.0


def replaced(topic, at, fields):
    return [
        (name, at if name == topic else when, fields if name == topic else told)
        for name, when, told in messages()
    ]


@pytest.mark.parametrize(
    ("topic", "fields", "what"),
    [
        ("/cam/camera_info", info_fields(binning_x=2), "binned or cut"),
        ("/cam/camera_info", info_fields(distortion_model="omni"), "'omni' is none of"),
        ("/cam/camera_info", info_fields(k=np.zeros(9)), "camera_matrix: not that of a calibrated camera"),
        ("/tf_static", {"transforms": STATIC[:2]}, "no transform from base_link to 'camera_optical'"),
        (
            "/tf_static",
            {"transforms": (*STATIC[:2], NOWHERE)},
            "no transform from base_link to 'camera_optical'",
        ),
        (
            "/tf_static",
            {"transforms": (transform("base_link", "camera_optical", (0, 0, 1)),)},
            "no optical frame",
        ),
        (
            "/tf_static",
            {"transforms": (transform("base_link", "camera_optical", (0, 0, -1), MOUNT),)},
            "-1.00 m above the floor",
        ),
        (
            "/tf_static",
            {"transforms": (*STATIC, transform("base_link", "mast", (0, 0, 0)))},
            "no transform from",
        ),
        ("/cam/image_raw", raw_fields(101 * S, drawn(0), "32FC1"), "images are '32FC1'"),
    ],
)
def test_bags_that_cannot_be_used(tmp_path, topic, fields, what):
    bag = write_messages(tmp_path / "bag", TOPICS, replaced(topic, 101 * S, fields))
    with pytest.raises(InputError, match=what) as refused:
        open_session(bag).frames[0].image()
    assert str(bag) in str(refused.value)


def without(*names):
    topics = {name: kind for name, kind in TOPICS.items() if name not in names}
    return topics, [message for message in messages() if message[0] not in names]


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (("/odom",), "no odometry"),
        (("/cam/camera_info",), "neither a CameraInfo topic"),
        (("/cam/image_raw",), "neither images nor fixes"),
    ],
)
def test_bags_without_what_is_needed(tmp_path, names, what):
    with pytest.raises(InputError, match=what):
        open_session(write_messages(tmp_path / "bag", *without(*names)))


def test_wheel_angles_need_the_wheels(tmp_path):
    topics, said = without("/odom")
    fields = {"name": ["left_wheel", "right_wheel"]}
    turns = [
        ("/joints", at, {"header": header(at, ""), **fields, "position": np.array([at, at]) / S})
        for at in range(100 * S, 105 * S, S // 10)
    ]
    bag = write_messages(tmp_path / "bag", topics | {"/joints": JOINTS}, [*said, *turns])
    with pytest.raises(InputError, match="no odometry"):
        open_session(bag)
    with pytest.raises(InputError, match="wheels: missing"):
        open_session(bag, Reading(wanted=Wanted({Role.ODOMETRY: "/joints"})))
    (tmp_path / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.4}\n")
    odometry = open_session(bag).odometry
    assert odometry.wheels.baseline_m == 0.4
    np.testing.assert_allclose(np.diff(odometry.values, axis=0), 0.1, atol=1e-9)


def test_memory_does_not_grow_with_the_bag(tmp_path):
    count, side = 150, 400
    many = [
        (
            "/cam/image_raw",
            (101 * 30 + number) * S // 30,
            raw_fields((101 * 30 + number) * S // 30, drawn(number % 7, side, side)),
        )
        for number in range(count)
    ]
    said = [message for message in messages() if message[0] != "/cam/image_raw"]
    info = info_fields(side, side)
    said = [(topic, at, info if topic == "/cam/camera_info" else fields) for topic, at, fields in said]
    bag = write_messages(tmp_path / "bag", TOPICS, [*said, *many])
    del many, said
    assert sum(file.stat().st_size for file in bag.iterdir()) > count * side * side
    open_session(bag)
    tracemalloc.start()
    try:
        session = open_session(bag)
        for frame in session.frames:
            assert frame.image().shape == (side, side)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.35 * count * side * side
