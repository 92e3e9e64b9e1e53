"""`wireloc locate`: what it answers, what it says when it finds nothing, and that it says what takes long."""

import json
import math

import pytest

#: The bundled session's first picture: where it was taken.
STAMP_S, IMAGE = 0.2, "images/000000.jpg"


@pytest.fixture(scope="module")
def true(sample):
    """Return x, y, phi of the picture."""
    rows = (sample / "ground_truth_dense.csv").read_text().splitlines()[1:]
    row = next(row for row in rows if float(row.split(",")[0]) >= STAMP_S)
    return [float(cell) for cell in row.split(",")[1:]]


@pytest.fixture
def locate(wireloc, sample, tmp_path):
    """Return the command with the sample's picture, map and robot."""

    def command(*options, image=sample / IMAGE, robot=sample / "robot.yaml"):
        files = ("--map", sample / "map.yaml", "--robot", robot, "--overlay", tmp_path / "seen.png")
        return wireloc("locate", image, *files, *options)

    return command


def near(pose):
    return ",".join(map(str, pose))


def test_a_place_near_one_that_is_told(locate, true, tmp_path):
    ended = locate("--near", near([true[0] + 0.2, true[1] - 0.2, true[2] + 0.1]), "--json")
    assert (ended.code, ended.err) == (0, "")
    answer = json.loads(ended.out)
    assert (answer["outcome"], answer["reason"]) == ("FIX", None)
    (pose,) = answer["poses"]
    assert math.hypot(pose["x_m"] - true[0], pose["y_m"] - true[1]) < 0.1
    assert abs(pose["phi_rad"] - true[2]) < math.radians(2.0)
    assert pose["odds"] == 1.0
    assert answer["overlay"] == str(tmp_path / "seen.png")
    assert (tmp_path / "seen.png").read_bytes().startswith(b"\x89PNG")
    said = locate("--near", near(true)).out.splitlines()
    assert said[0].startswith(f"x {pose['x_m']:.1f}")
    assert said[-1].endswith(f"lines; {tmp_path / 'seen.png'}")


def test_no_place_is_told_with_its_reason_and_where_it_looked(locate, true):
    ended = locate("--near", near([true[0], true[1], true[2] + 3.0]), "--within", "0.3,10")
    assert ended.code == 1
    assert ended.out.startswith("no fix: ")
    assert ended.err == "searched within 0.3,10 (m, degrees) of --near; without --near, everywhere\n"


def test_what_takes_long_is_told_on_a_terminal_alone(locate, true, monkeypatch):
    assert locate("--near", near(true)).err == ""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    ended = locate("--near", near(true), "--json")
    assert "what can be seen from where" in ended.err
    assert "compiling" in ended.err
    json.loads(ended.out)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--near", "1,2"), "--near: expected X,Y,PHI in numbers"),
        (("--near", "1,2,nan"), "--near: expected X,Y,PHI in numbers"),
        (("--within", "1,2"), "--within: says nothing without --near"),
        (("--near", "1,2,0", "--within", "1"), "--within: expected DT_M,DPHI_DEG"),
        (("--near", "1,2,0", "--within", "0,5"), "--within: not above zero"),
        (("--overlay", "seen.jpg"), "--overlay: draws into a .png"),
    ],
)
def test_options_that_cannot_be(locate, options, what):
    ended = locate(*options)
    assert (ended.code, ended.err.count("\n"), ended.out) == (2, 1, "")
    assert what in ended.err


def test_pictures_and_robots_that_do_not_fit(locate, sample, tmp_path):
    def told(**files):
        ended = locate(**files)
        assert (ended.code, ended.err.count("\n")) == (2, 1)
        return ended.err

    (tmp_path / "broken.jpg").write_bytes((sample / IMAGE).read_bytes()[:100])
    assert "broken.jpg" in told(image=tmp_path / "broken.jpg")
    assert "none.jpg" in told(image=tmp_path / "none.jpg")
    text = (sample / "robot.yaml").read_text()
    (tmp_path / "other.yaml").write_text(text.replace("width: 640", "width: 320"))
    assert "is 640x480, but the camera makes 320x480" in told(robot=tmp_path / "other.yaml")
    (tmp_path / "blind.yaml").write_text("wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    assert "blind.yaml: camera: missing" in told(robot=tmp_path / "blind.yaml")
    assert not (tmp_path / "seen.png").exists()
