"""A session folder: what is found, what is refused, and the order in which it is replayed."""

import dataclasses
import itertools
import math
import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from localization.odometry import OdometryNoise, OdometryStep, advance
from maps.errors import InputError
from runs.session import Frame, Odometry, RecordedFix, read_session

NOISE = OdometryNoise()


@pytest.fixture
def pictures(tmp_path, sample):
    """Return a copy of the sample with its first two frames."""
    folder = tmp_path / "pictures"
    (folder / "images").mkdir(parents=True)
    for name in ("robot.yaml", "map.yaml", "odometry.csv"):
        shutil.copyfile(sample / name, folder / name)
    for name in ("images/000000.jpg", "images/000001.jpg"):
        shutil.copyfile(sample / name, folder / name)
    rows = (sample / "frames.csv").read_text().splitlines()[:3]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def looks(session):
    return [event for event in session.events(NOISE) if not isinstance(event, OdometryStep)]


def test_session_with_images(pictures):
    session = read_session(pictures)
    assert session.name == "pictures"
    assert [frame.filename for frame in session.frames] == ["images/000000.jpg", "images/000001.jpg"]
    assert session.frames[1].stamp_ns == session.frames[1].arrival_ns == 1_450_000_000
    assert len(session.wire_map) == 402
    assert session.initial.stamp_ns == session.start_ns == 0


def test_map_one_folder_up_or_named(pictures, tmp_path):
    above = pictures.parent / "map.yaml"
    (pictures / "map.yaml").rename(above)
    assert read_session(pictures).map_path == above
    named = tmp_path / "else.yaml"
    above.rename(named)
    assert len(read_session(pictures, named).wire_map) == 402
    with pytest.raises(InputError, match=r"map\.yaml: no such file, nor one folder up"):
        read_session(pictures)


def test_perfect_wheels_lead_along_the_circle(toy):
    session = read_session(toy)
    steps = [event for event in session.events(NOISE) if isinstance(event, OdometryStep)]
    *_, pose = itertools.accumulate(steps, advance, initial=session.initial.pose)
    last = np.loadtxt(toy / "ground_truth_dense.csv", delimiter=",", skiprows=1)[-1]
    np.testing.assert_allclose(pose.as_array(), last[1:], atol=1e-6)


def test_twist_holds_until_the_next_row(toy):
    rows = "timestamp_s,forward_mps,turn_radps\n0,1,0.5\n2,0,0\n9,7,7\n"
    (toy / "odometry.csv").write_text(rows)
    steps = list(read_session(toy).odometry.steps(NOISE))
    assert [(step.forward_m, step.turn_rad) for _, step in steps] == [(2.0, 1.0), (0.0, 0.0)]


def test_steps_come_in_order_when_a_row_is_late():
    odometry = Odometry(
        stamps_ns=np.array([0, 10, 20, 30]),
        arrivals_ns=np.array([0, 25, 21, 31]),
        values=np.zeros((4, 2)),
        wheels=None,
    )
    steps = list(odometry.steps(NOISE))
    assert [(arrival, step.stamp_ns) for arrival, step in steps] == [(25, 10), (25, 20), (31, 30)]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(delays=st.lists(st.integers(0, 40), min_size=8, max_size=8))
def test_stream_is_ordered_by_arrival(toy, delays):
    session = read_session(toy)
    late = [
        RecordedFix(fix.stamp_ns, fix.stamp_ns + delay * 50_000_000, fix.fix)
        for fix, delay in zip(session.fixes, delays, strict=False)
    ]
    session = dataclasses.replace(session, fixes=tuple(late))
    events = list(session.events(NOISE))
    arrivals = [e.stamp_ns if isinstance(e, OdometryStep) else e.arrival_ns for e in events]
    assert arrivals == sorted(arrivals)
    assert [e for e in events if not isinstance(e, OdometryStep)] == sorted(
        late, key=lambda fix: (fix.arrival_ns, fix.stamp_ns)
    )


def test_odometry_goes_first_then_stamp_then_row(toy):
    session = read_session(toy)
    first, second = session.fixes[:2]
    at = 1_000_000_000
    twin = RecordedFix(400_000_000, at, first.fix)
    same = (RecordedFix(500_000_000, at, second.fix), twin, dataclasses.replace(twin))
    session = dataclasses.replace(session, fixes=same)
    events = list(session.events(NOISE))
    place = events.index(same[1])
    assert events[place - 1].stamp_ns == at
    assert isinstance(events[place - 1], OdometryStep)
    assert [id(event) for event in events[place : place + 3]] == [id(same[1]), id(same[2]), id(same[0])]


def test_time_offset_moves_images_to_the_clock_of_odometry(pictures):
    with (pictures / "robot.yaml").open("a") as robot:
        robot.write("\ntime_offset_s: 0.125\n")
    edit(pictures / "frames.csv", "timestamp_s,filename", "timestamp_s,filename,arrival_s")
    edit(pictures / "frames.csv", "000000.jpg", "000000.jpg,0.25")
    edit(pictures / "frames.csv", "000001.jpg", "000001.jpg,2.0")
    first, second = read_session(pictures).frames
    assert (first.stamp_ns, first.arrival_ns) == (325_000_000, 325_000_000)
    assert (second.stamp_ns, second.arrival_ns) == (1_575_000_000, 2_000_000_000)


def test_robot_stands_still_before_odometry_begins(pictures):
    with (pictures / "robot.yaml").open("a") as robot:
        robot.write("\ntime_offset_s: -1.0\n")
    session = read_session(pictures)
    assert session.initial.stamp_ns == session.start_ns == -800_000_000
    frame, still, *_ = session.events(NOISE)
    assert isinstance(frame, Frame)
    assert (still.start_ns, still.stamp_ns, still.forward_m) == (-800_000_000, 0, 0.0)


def test_position_only_fix(toy):
    (toy / "fixes.csv").write_text(
        "timestamp_s,x_m,y_m,phi_rad,std_x_m,std_y_m,std_phi_rad\n1,1,2,,0.1,0.2,\n"
    )
    belief = read_session(toy).fixes[0].fix.belief
    assert belief.measured.tolist() == [True, True, False]
    assert math.isinf(belief.heading_std_rad)
    assert belief.covariance[1, 1] == pytest.approx(0.04)


def test_truth_is_never_opened(toy):
    before = read_session(toy)
    for name in ("ground_truth.csv", "ground_truth_dense.csv", "observable.csv"):
        (toy / name).unlink(missing_ok=True)
        (toy / name).mkdir()
    after = read_session(toy)
    assert [look.stamp_ns for look in looks(before)] == [look.stamp_ns for look in looks(after)]


@pytest.mark.parametrize(
    ("filename", "what"),
    [
        ("../secret.jpg", "is not a path inside the session folder"),
        ("images/../../secret.jpg", "is not a path inside the session folder"),
        ("/etc/hostname", "is not a path inside the session folder"),
        ("", "is not a path inside the session folder"),
        ("images/absent.jpg", "no such file"),
        ("images", "no such file"),
    ],
)
def test_frame_names_its_line(pictures, filename, what):
    edit(pictures / "frames.csv", "images/000001.jpg", filename)
    with pytest.raises(InputError, match=what) as error:
        read_session(pictures)
    assert error.value.path.endswith("frames.csv")
    assert error.value.where == "line 3"


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ("1,1,2,0.1,0.1,0.1,", "phi_rad without std_phi_rad"),
        ("1,1,2,,0.1,0.1,0.1", "std_phi_rad without phi_rad"),
        ("1,1,2,0,0.1,0,0.1", "not above zero"),
        ("1,1,,0,0.1,0.1,0.1", "y_m: empty"),
    ],
)
def test_fix_names_its_line(toy, row, what):
    (toy / "fixes.csv").write_text(f"timestamp_s,x_m,y_m,phi_rad,std_x_m,std_y_m,std_phi_rad\n{row}\n")
    with pytest.raises(InputError, match=f"line 2: .*{what}"):
        read_session(toy)


def test_nothing_to_localize_with(toy):
    (toy / "fixes.csv").unlink()
    with pytest.raises(InputError, match=r"neither frames\.csv nor fixes\.csv"):
        read_session(toy)


def test_images_need_a_camera(pictures):
    (pictures / "robot.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    with pytest.raises(InputError, match=r"robot\.yaml: camera: missing"):
        read_session(pictures)


def test_wheel_angles_need_wheels(toy):
    (toy / "robot.yaml").write_text("wheels: null\n")
    with pytest.raises(InputError, match=r"robot\.yaml: wheels: missing"):
        read_session(toy)


def test_odometry_of_another_kind(toy):
    (toy / "odometry.csv").write_text("timestamp_s,left_wheel_rad\n0,0\n1,1\n")
    with pytest.raises(InputError, match=r"odometry\.csv: line 1: neither left_wheel_rad"):
        read_session(toy)


def test_no_folder(tmp_path):
    with pytest.raises(InputError, match="no such session folder"):
        read_session(tmp_path / "nothing")
