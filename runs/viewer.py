"""Looking at a recording: in a window, or as a picture without a screen."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import rerun_cli  # type: ignore[import-untyped]
from rerun.experimental import ViewerClient

from maps.errors import InputError, MissingExtraError
from runs.blueprint import TABS
from runs.folder import read_steps

#: The program itself; the `rerun` on the path is a wrapper that would leave it behind when killed.
VIEWER = Path(rerun_cli.__file__).with_name("rerun")

WINDOW_SIZE = "1920x1080"

#: How long a viewer without a screen takes to find out.
WINDOW_S = 1.0

#: How long the viewer may take to start, and to draw what it was given.
START_S, SETTLE_S = 30.0, 4.0

NO_VULKAN = "no Vulkan driver to draw with; on Debian: apt install mesa-vulkan-drivers"


def view(run: Path) -> None:
    """Show a run's recording in the rerun viewer, until its window is closed.

    InputError where the folder has no recording, MissingExtraError where the viewer cannot start.
    """
    ended = subprocess.run([VIEWER, recording_of(run), "--port", "auto"], check=False)
    if ended.returncode:
        raise MissingExtraError(
            f"the rerun viewer ended with code {ended.returncode}: no screen, or {NO_VULKAN}"
        )


def start_viewer() -> str:
    """Open a viewer's window, to stay open when this process has ended, and return its URL.

    MissingExtraError where it cannot start.
    """
    port = _free_port()
    command = [str(VIEWER), "--port", str(port), "--hide-welcome-screen", "--expect-data-soon"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    no_window = MissingExtraError(f"the rerun viewer could not open a window: no screen, or {NO_VULKAN}")
    try:
        _wait_for(port, process)
    except MissingExtraError:
        raise no_window from None
    # It listens before it has a window, and ends where there is no screen for one.
    with suppress(subprocess.TimeoutExpired):
        process.wait(WINDOW_S)
        raise no_window
    return viewer_url(str(port))


def viewer_url(address: str) -> str:
    """Return the URL of a viewer from what people type: a port, HOST:PORT, or the URL itself."""
    if "://" in address:
        return address
    host, _, port = address.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 2**16:
        raise InputError("--connect", "", f"expected HOST:PORT or a rerun+http:// URL, not {address!r}")
    return f"rerun+http://{host or '127.0.0.1'}:{port}/proxy"


def screenshot(run: Path, out: Path, time_s: float | None = None, tab: str = "where") -> None:
    """Save a picture (PNG) of a recording at a time of the session; needs no screen.

    `run`: as `recording_of` takes it. `time_s` as in the session's files; None: the last look. `tab`: one of
    `runs.blueprint.TABS`. InputError where there is no recording or the picture cannot be written,
    MissingExtraError where the viewer cannot start.
    """
    recording = recording_of(run)
    if tab not in TABS:
        raise InputError("--tab", "", f"one of {', '.join(TABS)}, not {tab!r}")
    if time_s is None and (recording.parent / "steps.csv").exists():
        time_s = max((float(step["timestamp_s"]) for step in read_steps(recording.parent)), default=0.0)
    if not out.resolve().parent.is_dir():
        raise InputError(out, "", "no such folder to write to")
    with _headless_viewer() as client:
        client.open(str(recording.resolve()))
        if time_s is not None:
            client.set_time("sim_time", duration=time_s, play_state="paused")
        time.sleep(SETTLE_S)
        if tab != "where":
            _bring_to_front(client, tab)
            time.sleep(SETTLE_S)
        client.save_screenshot(str(out.resolve()))


def recording_of(run: Path) -> Path:
    """Return the recording of a run folder, of a comparison's folder, or the file itself; InputError for none."""
    if run.is_file():
        return run
    names = ("run.rrd", "comparison.rrd")
    path = next((run / name for name in names if (run / name).is_file()), None)
    if path is None:
        raise InputError(run / names[0], "", "no such recording")
    return path


def _bring_to_front(client: ViewerClient, tab: str) -> None:
    """Open a tab of the arrangement on show; one without tabs stays as it is."""
    board = client.get_blueprint().blueprint
    for part in board.values():
        container = part.get("ContainerBlueprint", {})
        if container.get("container_kind") != "Tabs":
            continue
        for page in container["contents"]:
            name = board.get(f"/{page}", {}).get("ContainerBlueprint", {}).get("display_name")
            if name == TABS[tab]:
                container["active_tab"] = page
    client.set_blueprint(board, "recording")


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
