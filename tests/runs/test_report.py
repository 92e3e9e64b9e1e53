"""The report: one page that needs nothing else, and hides nothing."""

import csv
import json
import re
import shutil
from xml.etree import ElementTree

import pytest

from maps.errors import InputError
from runs.folder import read_run
from runs.page import number, page, table
from runs.plots import cumulative, errors_over_time, plan, svg
from runs.report import write_report


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
    assert all(link.startswith("#") for link in links)
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


def test_page_and_table_escape():
    assert "<b>" not in page("<b>", [table(["<b>"], [["<b>"]])])
    assert number(None) == "-"
    assert number(1.23456, " m", 2) == "1.23 m"
