"""Looking at a recording: in a window, or as a picture without a screen."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun_cli  # type: ignore[import-untyped]
from rerun.experimental import ViewerClient

from maps.errors import InputError, MissingExtraError
from runs.folder import read_steps

#: The program itself; the `rerun` on the path is a wrapper that would leave it behind when killed.
VIEWER = Path(rerun_cli.__file__).with_name("rerun")

WINDOW_SIZE = "1920x1080"

#: How long the viewer may take to start, and to draw what it was given.
START_S, SETTLE_S = 30.0, 4.0

NO_VULKAN = "no Vulkan driver to draw with; on Debian: apt install mesa-vulkan-drivers"


def view(run: Path) -> None:
    """Show a run's recording in the rerun viewer, until its window is closed.

    InputError where the folder has no recording, MissingExtraError where the viewer cannot start.
    """
    ended = subprocess.run([VIEWER, _recording(run), "--port", "auto"], check=False)
    if ended.returncode:
        raise MissingExtraError(
            f"the rerun viewer ended with code {ended.returncode}: no screen, or {NO_VULKAN}"
        )


def screenshot(run: Path, out: Path, time_s: float | None = None) -> None:
    """Save a picture (PNG) of a run's recording at a time of the session; needs no screen.

    `time_s` as in the session's files; None: the last look. InputError where the folder has no recording
    or the picture cannot be written, MissingExtraError where the viewer cannot start.
    """
    recording = _recording(run)
    if time_s is None:
        time_s = max((float(step["timestamp_s"]) for step in read_steps(run)), default=0.0)
    if not out.resolve().parent.is_dir():
        raise InputError(out, "", "no such folder to write to")
    with _headless_viewer() as client:
        client.open(str(recording.resolve()))
        client.set_time("sim_time", duration=time_s, play_state="paused")
        time.sleep(SETTLE_S)
        client.save_screenshot(str(out.resolve()))


def _recording(run: Path) -> Path:
    path = run / "run.rrd"
    if not path.is_file():
        raise InputError(path, "", "no such recording")
    return path


@contextmanager
def _headless_viewer() -> Iterator[ViewerClient]:
    """Start a viewer without a window on a free port, and end it whatever happens."""
    port = _free_port()
    command = [
        str(VIEWER),
        "--headless",
        "--port",
        str(port),
        "--window-size",
        WINDOW_SIZE,
        "--hide-welcome-screen",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        _wait_for(port, process)
        yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    except (RuntimeError, ConnectionError) as error:  # rerun: no answer, or the wrong one
        raise MissingExtraError(f"the rerun viewer gave no picture ({error}): {NO_VULKAN}") from None
    finally:
        process.kill()
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise MissingExtraError(f"the rerun viewer could not start: {NO_VULKAN}")
