"""One writer a folder: the second is refused, whoever was killed holds nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from maps.errors import InputError
from runs.folderlock import sole_writer
from runs.results import StagedFolder

REPOSITORY = Path(__file__).resolve().parents[2]

WRITER = """
import sys
from pathlib import Path
from runs.results import StagedFolder
with StagedFolder(Path(sys.argv[1])) as folder:
    (folder / "half").write_text("half")
    print("writing", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def writer(tmp_path):
    """Start a process that writes to a run folder until it gets a line."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / "run")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=REPOSITORY,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    yield process
    process.kill()
    process.communicate()


def test_a_second_run_into_the_same_folder_is_refused_and_disturbs_nothing(writer, tmp_path):
    with (
        pytest.raises(InputError, match=r"run: another run is writing there$"),
        StagedFolder(tmp_path / "run"),
    ):
        pass
    assert (tmp_path / "run.partial" / "half").read_text() == "half"
    writer.communicate("done\n")
    assert writer.returncode == 0
    assert (tmp_path / "run" / "half").read_text() == "half"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_a_killed_run_left_does_not_pass_for_whole_and_gives_way(writer, tmp_path):
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert not (tmp_path / "run").exists()
    assert (tmp_path / "run.partial" / "half").exists()
    with StagedFolder(tmp_path / "run") as folder:
        assert list(folder.iterdir()) == []
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_folder_filled_between_look_and_lock_is_kept(tmp_path):
    staged = StagedFolder(tmp_path / "run")
    with StagedFolder(tmp_path / "run") as folder:
        (folder / "first").touch()
    with pytest.raises(InputError, match="not empty"), staged:
        pass
    assert [path.name for path in tmp_path.rglob("*")] == ["run", "first"]


def test_a_folder_is_free_again_after_its_writer(tmp_path):
    for _ in range(2):
        refused = pytest.raises(InputError, match="another run")
        with sole_writer(tmp_path / "sweep"), refused, sole_writer(tmp_path / "sweep"):
            pass


@pytest.mark.parametrize("out", ["/proc/wireloc/run", "/dev/null/run"])
def test_where_nothing_can_be_written_is_told_in_one_line(wireloc, toy, out):
    ended = wireloc("run", toy, "--out", out, "--log", "off")
    assert ended.code == 2
    assert ended.err.count("\n") == 1
    assert "Traceback" not in ended.err


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_read_only_place_is_told_in_one_line(wireloc, toy, tmp_path):
    (tmp_path / "kept").mkdir(mode=0o500)
    ended = wireloc("run", toy, "--out", tmp_path / "kept" / "run", "--log", "off")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert list((tmp_path / "kept").iterdir()) == []


def test_a_full_disk_leaves_nothing_and_is_told_in_one_line(wireloc, toy, tmp_path, monkeypatch):
    def full(*_arguments, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("runs.navigation.write_metrics", full)
    ended = wireloc("run", toy, "--out", tmp_path / "out" / "run", "--log", "off")
    assert ended.code == 2
    assert ended.err.strip().splitlines() == ["wireloc: [Errno 28] No space left on device"]
    assert list((tmp_path / "out").iterdir()) == []
