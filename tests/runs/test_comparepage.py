"""A comparison as people get it: one table, a page, one recording with all runs."""

import json

import numpy as np
import pytest
from rerun.chunk import RrdReader

from runs.compare import named_apart, rows_of
from runs.comparepage import HEADER, QUANTITIES, table_rows
from runs.compareplots import innovations
from runs.comparerecording import record_comparison
from runs.folder import read_run
from runs.plots import svg
from runs.runlog import Trajectory
from runs.tracks import along_and_across
from tests.runs.test_compare import write_run, write_tum


@pytest.fixture
def runs(tmp_path):
    return [write_run(tmp_path / "one"), write_run(tmp_path / "two", truth=False)]


def test_errors_are_split_along_and_across_the_way():
    reference = Trajectory(np.array([0, 10]), np.array([[0.0, 0.0, np.pi / 2], [0.0, 1.0, np.pi / 2]]))
    track = Trajectory(np.array([5]), np.array([[0.3, 0.9, 0.0]]))
    along_m, across_m = along_and_across(track, reference)
    assert (along_m[0], across_m[0]) == pytest.approx((0.4, 0.3))


def test_table_tells_each_row_once(runs):
    rows = [row for run in runs for row in rows_of(read_run(run))]
    lines = table_rows(rows)
    assert len(lines) == len(rows) * len(QUANTITIES)
    assert {len(line) for line in lines} == {len(HEADER)}
    assert [line[0] for line in lines if line[0]][:2] == ["one: odometry", "one: raw vision"]
    first = dict(zip(HEADER, lines[0], strict=True))
    assert (first["median"], first["wrong"]) == ("0.400", "21")


def test_runs_of_one_name_are_told_apart(tmp_path):
    folders = []
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        folders.append(read_run(write_run(tmp_path / place / "run")))
    assert [run.name for run in named_apart(folders)] == ["run (1)", "run (2)"]


def test_fixed_lag_is_compared_where_it_ran(runs):
    assert "fixed_lag" not in {row.track for row in rows_of(read_run(runs[0]))}
    write_tum(runs[0] / "fixed_lag.tum", [(t, t, 0.03, 0.0) for t in np.arange(0.0, 10.1, 0.5)])
    rows = {row.track: row for row in rows_of(read_run(runs[0]))}
    assert rows["fixed_lag"].across_m.median == pytest.approx(0.03)
    assert list(rows) == ["odometry", "vision", "filtered", "fixed_lag", "smoothed"]


def test_recording_has_the_runs_side_by_side_on_common_timelines(runs, tmp_path):
    # The second one begins a thousand seconds later.
    for name in ("odometry", "filtered", "smoothed"):
        seconds = 1000.0 + np.arange(0.0, 10.1, 0.5)
        write_tum(runs[1] / f"{name}.tum", [(t, t - 1000.0, 0.1, 0.0) for t in seconds])
    record_comparison(tmp_path / "comparison.rrd", [read_run(run) for run in runs])
    found = {}
    for chunk in RrdReader(tmp_path / "comparison.rrd").stream().to_chunks():
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    for run in ("one", "two"):
        assert f"/{run}/world/tracks/filtered" in found
        assert f"/{run}/world/fixes/accepted" in found
        assert f"/plots/position/{run}/filtered" in found
    assert "/one/world/tracks/truth" in found
    assert "/two/world/tracks/truth" not in found
    begins = {
        run: min(
            batch.column("since_start").to_pylist()[0]
            for batch in found[f"/plots/position/{run}/filtered"]
            if "since_start" in batch.schema.names
        )
        for run in ("one", "two")
    }
    assert begins["one"] == begins["two"]


def test_innovations_leave_out_fixes_without_a_heading(runs):
    steps = (
        (runs[0] / "steps.csv")
        .read_text()
        .replace(",FUSED,,", ",FUSED,2.5,")
        .replace(",REJECTED,,", ",REJECTED,99,")
    )
    (runs[0] / "steps.csv").write_text(steps)
    figure = innovations([read_run(runs[0])])
    heights = [[bar.get_height() for bar in bars] for bars in figure.axes[0].containers]
    assert [sum(bars) for bars in heights] == [1.0, 1.0]
    assert heights[0][2] == 1.0
    assert heights[1][-1] == 1.0
    assert "chi-square" in svg(figure)


def test_command_prints_the_table_or_json(wireloc, runs, tmp_path, monkeypatch):
    # The page and its figures have tests of their own, and take long.
    monkeypatch.setattr("runs.compare.write_comparison", lambda *_: None)
    ended = wireloc("compare", *runs, "--out", tmp_path / "out")
    assert ended.code == 0
    for word in ("one: raw vision", "across, m", "ANEES", "No ground truth in two"):
        assert word in ended.out
    told = wireloc("compare", *runs, "--json")
    assert json.loads(told.out)["rows"][0]["position_m"]["median"] == pytest.approx(0.4)
