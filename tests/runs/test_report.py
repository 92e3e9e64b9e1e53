"""The report: one page that needs nothing else, and hides nothing."""

import csv
import dataclasses
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from maps.errors import InputError
from runs.config import RunConfig
from runs.folder import read_run
from runs.logdetail import LogDetail
from runs.navigation import Watching, navigate
from runs.page import number, page, table
from runs.plots import cumulative, errors_over_time, plan, svg
from runs.report import write_report
from runs.runlog import Trajectory
from runs.session import read_session
from runs.worst import WORST


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """Return a folder that keeps what takes long to make."""
    return tmp_path_factory.mktemp("shelf")


@pytest.fixture
def run(tmp_path, toy, wireloc, shelf):
    """Return a fresh copy of the run folder of the toy drive."""
    kept = shelf / "run"
    if not kept.exists():
        assert wireloc("run", toy, "--out", kept).code == 0
    return shutil.copytree(kept, tmp_path / "out")


def change_steps(folder, **cells):
    """Write the same cells into every row of steps.csv."""
    path = folder / "steps.csv"
    with path.open(newline="") as file:
        rows = [row | cells for row in csv.DictReader(file)]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def test_report_needs_nothing_from_outside(run):
    html = (run / "report.html").read_text()
    links = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", html)
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in html
    assert not re.findall(r"url\((?!#)", html)
    assert "<script" not in html


def test_report_tells_the_metrics(run):
    html = (run / "report.html").read_text()
    metrics = json.loads((run / "metrics.json").read_text())
    assert "<h1>toy</h1>" in html
    assert f"{metrics['filtered']['position_error_m']['rmse']:.3f} m" in html
    assert f"{metrics['vision']['accepted']} of {metrics['vision']['attempted']}" in html
    assert "versions:" in html
    assert html.index("<svg") < html.index("<table")


def test_report_lists_looks_that_were_not_used_and_why(run):
    assert "Every look gave a fix" in (run / "report.html").read_text()
    change_steps(run, outcome="NO_FIX", verdict="MISSED", reason="WEAK_EVIDENCE", fix_x_m="")
    write_report(run)
    html = (run / "report.html").read_text()
    count = len((run / "steps.csv").read_text().splitlines()) - 1
    assert f"{count} of {count}: WEAK_EVIDENCE {count}." in html
    assert html.count("<td>WEAK_EVIDENCE</td>") == count


def test_report_without_truth_says_so(toy, tmp_path, wireloc):
    (toy / "ground_truth_dense.csv").unlink()
    out = tmp_path / "blind"
    assert wireloc("run", toy, "--out", out).code == 0
    html = (out / "report.html").read_text()
    assert "for want of a truth" in html
    assert not re.search(r"\bnan\b", html)


def test_report_escapes_what_it_is_given(run):
    change_steps(run, filename="<script>alert(1)</script>", verdict="REJECTED")
    write_report(run)
    html = (run / "report.html").read_text()
    assert "<script" not in html


def test_report_of_half_a_run_is_refused(run):
    (run / "smoothed.tum").unlink()
    with pytest.raises(InputError, match=r"smoothed\.tum"):
        write_report(run)


def test_figures_are_svg_in_the_colour_of_the_text(run):
    folder = read_run(run)
    for figure in (plan([folder, folder]), errors_over_time(folder), cumulative([folder])):
        element = svg(figure)
        ElementTree.fromstring(element)
        assert "currentColor" in element
        assert "#1f2328" not in element


def test_figures_are_the_same_every_time(run):
    folder = read_run(run)
    assert svg(plan([folder])) == svg(plan([folder]))


def test_the_plan_of_a_long_drive_is_no_larger_than_that_of_a_short_one(run, monkeypatch):
    monkeypatch.setattr("runs.plots.ELLIPSES", 100)
    monkeypatch.setattr("runs.plots.POINTS", 200)
    folder, sizes = read_run(run), []
    for times in (25, 100):
        tracks = {name: _longer(track, times) for name, track in folder.tracks.items()}
        drive = dataclasses.replace(folder, tracks=tracks, truth=None, steps=folder.steps * times)
        sizes.append(len(re.sub(r"<use[^>]*>", "", svg(plan([drive])))))
    assert sizes[1] < 1.2 * sizes[0], "but for the fixes, a point each"


def _longer(track, times):
    """Return a track so many times as long, a little aside each time: no line lies on another."""
    poses = np.vstack([track.poses + [0.01 * lap, 0.0, 0.0] for lap in range(times)])
    stamps_ns = np.concatenate([track.stamps_ns + lap * 10**10 for lap in range(times)])
    return Trajectory(stamps_ns, poses)


def test_page_and_table_escape():
    assert "<b>" not in page("<b>", [table(["<b>"], [["<b>"]])])
    assert number(None) == "-"
    assert number(1.23456, " m", 2) == "1.23 m"


class Frame(HTMLParser):
    """Gathers a page's headings in order, and the captions of its pictures."""

    def __init__(self):
        super().__init__()
        self.open, self.headings, self.captions = "", [], []

    def handle_starttag(self, tag, attrs):  # noqa: ARG002
        self.open = tag

    def handle_data(self, data):
        if self.open == "h2" and data.strip():
            self.headings.append(data)
        if self.open == "figcaption" and data.strip():
            self.captions.append(data)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory, sample):
    """Return the run folder of the first seconds of the bundled session, images and all."""
    folder = tmp_path_factory.mktemp("drawn") / "session"
    shutil.copytree(sample, folder)
    lines = (folder / "frames.csv").read_text().splitlines(keepends=True)
    (folder / "frames.csv").write_text("".join(lines[:9]))
    lines = (folder / "odometry.csv").read_text().splitlines(keepends=True)
    (folder / "odometry.csv").write_text("".join(lines[:600]))
    # A covered lens.
    fourth = folder / lines_of(folder / "frames.csv", "filename")[3]
    cv2.imwrite(str(fourth), np.zeros((480, 640), np.uint8))
    out = folder.parent / "out"
    navigate(read_session(folder), RunConfig(), out, lambda *_: None, Watching(LogDetail.OFF))
    return out


def lines_of(path, column):
    with path.open(newline="") as file:
        return [row[column] for row in csv.DictReader(file)]


def test_report_shows_the_worst_frames_and_why(drawn):
    page = Frame()
    html = (drawn / "report.html").read_text()
    page.feed(html)
    assert len(page.captions) == html.count("data:image/jpeg;base64,") == WORST
    assert "no fix: TOO_FEW_SEGMENTS, hardly any lines" in page.captions[0]
    assert " off" in page.captions[1]


def test_report_goes_from_plan_and_table_to_configuration(drawn):
    html = (drawn / "report.html").read_text()
    page = Frame()
    page.feed(html)
    assert html.index("<svg") < html.index("<dl>") < html.index("<table") < html.index("<figure")
    assert page.headings[0] == "Accuracy"
    assert page.headings[1] == f"The worst {WORST} frames"
    assert page.headings[-1] == "Configuration"


def test_report_in_a_browser(drawn, tmp_path):
    """Open it at a phone's width: nothing said on the console, nothing asked for, and not blank."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("needs Chromium")
    page = tmp_path / "report.html"
    # Whatever the page tried to fetch or run would be refused, and told on the console.
    policy = (
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">"
    )
    page.write_text((drawn / "report.html").read_text().replace("<head>", f"<head>{policy}", 1))
    picture = tmp_path / "report.png"
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--enable-logging=stderr", "--v=0"]
    command += ["--window-size=412,3000", f"--screenshot={picture}", page.as_uri()]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert "CONSOLE" not in ended.stderr
    shown = cv2.imread(str(picture))
    assert shown.shape[1] == 412
    # The pictures are there: grey photographs, not a blank page.
    assert np.mean(shown.min(axis=2) < 200) > 0.1
