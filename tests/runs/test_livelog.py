"""Watching a run while it goes: no viewer makes the estimator wait, whatever it does."""

import socket
import threading
import time

import pytest

from maps.errors import InputError
from runs import livelog
from runs.config import RunConfig
from runs.livelog import LiveLog
from runs.navigation import Watching, navigate
from runs.session import read_session
from runs.viewer import viewer_url


@pytest.fixture
def hanging():
    """Return the URL of a viewer that takes connections and then does nothing, and those that it took."""
    taken = []
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(5)

        def take():
            try:
                while True:
                    taken.append(server.accept()[0])
            except OSError:
                return

        thread = threading.Thread(target=take, daemon=True)
        thread.start()
        yield viewer_url(str(server.getsockname()[1])), taken
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
    for connection in taken:
        connection.close()


def test_viewer_that_hangs_costs_the_run_nothing(toy, tmp_path, hanging, monkeypatch):
    monkeypatch.setattr(livelog, "END_S", 0.5)
    url, taken = hanging
    out = tmp_path / "out"

    def once_connected(done, _total):
        deadline = time.monotonic() + 60.0
        while done == 1 and not taken and time.monotonic() < deadline:
            time.sleep(0.05)

    navigation = navigate(read_session(toy), RunConfig(), out, once_connected, Watching(viewer=url))
    assert taken
    assert navigation.usable
    assert (out / "run.rrd").is_file()


def test_calls_that_do_not_fit_are_dropped(monkeypatch):
    monkeypatch.setattr(livelog, "BACKLOG", 3)
    monkeypatch.setattr(livelog, "END_S", 0.0)
    monkeypatch.setattr(livelog, "_serve", _never)
    log = LiveLog("rerun+http://127.0.0.1:1/proxy")
    for _ in range(10):
        log.belief(None)
    log.close()
    assert log.dropped >= 7


def _never(calls, url, detail):
    """Serve nobody."""


@pytest.mark.parametrize(
    ("typed", "url"),
    [
        ("9876", "rerun+http://127.0.0.1:9876/proxy"),
        ("robot:1234", "rerun+http://robot:1234/proxy"),
        ("rerun+http://robot:1/proxy", "rerun+http://robot:1/proxy"),
    ],
)
def test_viewer_is_named_by_port_host_or_url(typed, url):
    assert viewer_url(typed) == url


@pytest.mark.parametrize("typed", ["robot", "robot:x", "70000", ":"])
def test_viewer_that_is_no_address_is_refused(typed):
    with pytest.raises(InputError, match="--connect"):
        viewer_url(typed)


def test_connect_and_view_are_one_or_the_other(wireloc, toy, tmp_path):
    ended = wireloc("run", toy, "--out", tmp_path / "out", "--view", "--connect", "9876")
    assert ended.code == 2
    assert "--connect" in ended.err
    assert not (tmp_path / "out").exists()


def test_log_off_leaves_no_recording(wireloc, toy, tmp_path):
    out = tmp_path / "out"
    ended = wireloc("run", toy, "--out", out, "--log", "off")
    assert ended.code == 0
    assert not (out / "run.rrd").exists()
    assert "wireloc view" not in ended.out
