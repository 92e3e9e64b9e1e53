"""Looking at recordings: pictures without a screen, and what is told where that cannot be."""

from types import SimpleNamespace

import cv2
import pytest
import rerun as rr

from maps.errors import InputError, MissingExtraError
from runs import viewer
from runs.blueprint import TABS
from runs.runlog import COLUMNS
from runs.viewer import recording_of, screenshot, start_viewer, view


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


def test_tab_that_is_none_is_told(run, tmp_path):
    with pytest.raises(InputError, match="--tab: one of where, why"):
        screenshot(run, tmp_path / "picture.png", tab="weather")


def test_any_recording_can_be_named(run, tmp_path):
    assert recording_of(run / "run.rrd") == run / "run.rrd"
    (run / "run.rrd").rename(tmp_path / "comparison.rrd")
    assert recording_of(tmp_path) == tmp_path / "comparison.rrd"


def test_viewer_without_a_screen_is_told_before_the_run(monkeypatch):
    monkeypatch.setattr(viewer, "VIEWER", "/bin/false")
    with pytest.raises(MissingExtraError, match="mesa-vulkan-drivers"):
        start_viewer()


@pytest.mark.parametrize("tab", TABS)
def test_each_tab_comes_to_the_front(tab):
    boards = []
    tabs = {
        f"container/{name}": {"ContainerBlueprint": {"display_name": title}} for name, title in TABS.items()
    }
    outer = {"container_kind": "Tabs", "contents": list(tabs), "active_tab": "container/where"}
    board = {
        "/container/0": {"ContainerBlueprint": outer},
        **{f"/{path}": part for path, part in tabs.items()},
    }
    client = SimpleNamespace(
        get_blueprint=lambda: SimpleNamespace(blueprint=board),
        set_blueprint=lambda *told: boards.append(told),
    )
    viewer._bring_to_front(client, tab)
    ((shown, of),) = boards
    assert of == "recording"
    assert shown["/container/0"]["ContainerBlueprint"]["active_tab"] == f"container/{tab}"


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
