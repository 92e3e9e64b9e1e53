"""Writing into a copy of robot.yaml: what is told changes, all else stays as it was written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from boardviews import BARREL, FISHEYE
from hypothesis import given
from hypothesis import strategies as st

from maps.errors import InputError
from runs.calibrating import camera_keys
from runs.robot import read_robot
from runs.robotfile import MOUNT, with_block, with_camera
from runs.templates import ROBOT

KEYS = camera_keys(BARREL)

keys = st.sampled_from(["a", "b", "c", "d", "e"])
scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text("ab: #-'\n"),
)
values = st.one_of(scalars, st.lists(scalars, max_size=3), st.dictionaries(keys, scalars, max_size=2))


def edited(tmp_path: Path, text: str, camera: dict[str, Any] = KEYS) -> str:
    (tmp_path / "robot.yaml").write_text(text)
    return with_camera(tmp_path / "robot.yaml", camera)


def test_a_robot_file_keeps_its_comments_and_the_mount(tmp_path: Path) -> None:
    text = edited(tmp_path, ROBOT)
    (tmp_path / "new.yaml").write_text(text)
    old, new = read_robot(tmp_path / "robot.yaml"), read_robot(tmp_path / "new.yaml")
    assert old.camera is not None
    assert new.camera is not None
    assert (new.camera.fx, new.camera.width) == (BARREL.fx, BARREL.width)
    assert new.camera.distortion.tolist() == BARREL.distortion.tolist()
    assert new.camera.mount == old.camera.mount
    assert (new.wheels, new.start) == (old.wheels, old.start)
    changed = {line for line in text.splitlines() if line not in ROBOT.splitlines()}
    assert {line.split(":")[0].strip() for line in changed} <= set(KEYS)
    assert "fx: 270.0\n" in text


def test_another_lens_takes_the_old_ones_coefficients_away(tmp_path: Path) -> None:
    deviations = FISHEYE.distortion.repeat(2)
    camera = yaml.safe_load(edited(tmp_path, ROBOT, camera_keys(FISHEYE, deviations)))["camera"]
    assert camera["distortion_k1_k2_k3_k4"] == FISHEYE.distortion.tolist()
    assert camera["std_distortion_k1_k2_k3_k4"] == deviations[4:].tolist()
    assert "std_fx" in camera
    assert "distortion_k1_k2_p1_p2_k3" not in camera
    # Deviations of a calibration do not outlive it.
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump({"camera": camera}))
    again = yaml.safe_load(with_camera(tmp_path / "robot.yaml", KEYS))["camera"]
    assert not any(key.startswith("std_") for key in again)


@pytest.mark.parametrize(
    "text", ["wheels: {radius_m: 0.1, baseline_m: 0.3} # two\n", "camera: null\nx: 1\n", "x: 1"]
)
def test_where_there_was_no_camera_its_mount_is_left_open_and_the_reader_says_so(
    tmp_path: Path, text: str
) -> None:
    new = edited(tmp_path, text)
    assert MOUNT.rstrip() in new
    assert (
        yaml.safe_load(new).items()
        >= {k: v for k, v in yaml.safe_load(text).items() if k != "camera"}.items()
    )
    (tmp_path / "new.yaml").write_text(new)
    with pytest.raises(InputError, match=r"camera\.mount: field required"):
        read_robot(tmp_path / "new.yaml")
    start = new.index("  # mount:")
    filled = new[:start] + new[start:].replace("# mount", "mount").replace("  #   ", "    ")
    (tmp_path / "new.yaml").write_text(filled)
    assert read_robot(tmp_path / "new.yaml").camera is not None


def test_a_new_file() -> None:
    text = with_camera(None, KEYS)
    assert text.endswith(MOUNT)
    assert yaml.safe_load(text)["camera"]["fx"] == BARREL.fx


def test_a_camera_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="camera: expected keys and values"):
        edited(tmp_path, "camera: [1, 2]\n")


@given(
    st.dictionaries(keys, values, max_size=4),
    st.dictionaries(keys, values, max_size=4),
    st.dictionaries(
        keys, st.one_of(st.none(), st.floats(-9, 9), st.lists(st.floats(-9, 9), max_size=3)), max_size=5
    ),
    st.sampled_from([False, None, True]),
)
def test_any_file_reads_back_with_the_block_changed_and_nothing_else(
    others: dict[str, Any], block: dict[str, Any], changes: dict[str, Any], flow: bool | None
) -> None:
    content = {**others, "block": block, "last": 1}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=flow)
    expected = {key: value for key, value in {**block, **changes}.items() if changes.get(key, 0) is not None}
    again = yaml.safe_load(with_block(text, "block", changes))
    # An empty block reads as nothing.
    again["block"] = again["block"] or {}
    kept = {key: value for key, value in again["block"].items() if value is not None}
    assert kept == {key: value for key, value in expected.items() if value is not None}
    assert {**again, "block": None} == {**content, "block": None}
