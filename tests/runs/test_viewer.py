"""Looking at recordings: pictures without a screen, and what is told where that cannot be."""

import cv2
import pytest
import rerun as rr

from maps.errors import InputError, MissingExtraError
from runs import viewer
from runs.runlog import COLUMNS
from runs.viewer import screenshot, view


@pytest.fixture
def run(tmp_path):
    """Return a run folder with a recording of one line of text."""
    folder = tmp_path / "run"
    folder.mkdir()
    recording = rr.RecordingStream("test")
    recording.save(folder / "run.rrd")
    recording.set_time("sim_time", duration=1.0)
    recording.log("decisions", rr.TextLog("here"))
    recording.flush()
    recording.disconnect()
    cells = dict.fromkeys(COLUMNS, "") | {"timestamp_s": "1.0"}
    (folder / "steps.csv").write_text(",".join(COLUMNS) + "\n" + ",".join(cells.values()) + "\n")
    return folder


def test_missing_recording_is_named(tmp_path):
    for look in (lambda: view(tmp_path), lambda: screenshot(tmp_path, tmp_path / "picture.png")):
        with pytest.raises(InputError, match=r"run\.rrd: no such recording"):
            look()


def test_missing_folder_of_the_picture_is_named(run, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        screenshot(run, tmp_path / "nowhere" / "picture.png")


def test_viewer_that_ends_at_once_names_the_package(run, tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "VIEWER", "/bin/false")
    with pytest.raises(MissingExtraError, match="mesa-vulkan-drivers") as told:
        screenshot(run, tmp_path / "picture.png")
    assert "\n" not in str(told.value)
    with pytest.raises(MissingExtraError, match="mesa-vulkan-drivers"):
        view(run)


def test_viewer_without_vulkan_names_the_package(run, tmp_path, monkeypatch):
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nonexistent")
    monkeypatch.setattr(viewer, "SETTLE_S", 0.0)
    with pytest.raises(MissingExtraError, match="mesa-vulkan-drivers") as told:
        screenshot(run, tmp_path / "picture.png")
    assert "\n" not in str(told.value)
    assert not (tmp_path / "picture.png").exists()


def test_picture_without_a_screen(run, tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "SETTLE_S", 0.2)
    try:
        screenshot(run, tmp_path / "picture.png")
    except MissingExtraError as error:
        pytest.skip(str(error))
    picture = cv2.imread(str(tmp_path / "picture.png"))
    assert picture.shape == (1080, 1920, 3)
    assert picture.std() > 1.0
