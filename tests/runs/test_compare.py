"""Comparison: errors worked out again from what a run folder holds."""

import json
import math

import numpy as np
import pytest

from maps.errors import InputError
from runs.compare import compare, rows_of
from runs.folder import read_run, to_ns
from runs.runlog import COLUMNS, Trajectory
from runs.tracks import Spread, errors_of, interpolate, spread


def write_tum(path, rows):
    lines = (
        f"{second:.9f} {x} {y} 0 0 0 {math.sin(phi / 2)} {math.cos(phi / 2)}\n" for second, x, y, phi in rows
    )
    path.write_text("".join(lines))


def write_run(folder, *, truth=True, blind_truth=False):
    """Write a straight drive along x; each track is off by a known distance to the side and heading."""
    folder.mkdir()
    seconds = np.arange(0.0, 10.1, 0.5)
    for name, off_m, off_rad in (("odometry", 0.4, 0.2), ("filtered", 0.05, 0.02), ("smoothed", 0.02, 0.01)):
        write_tum(folder / f"{name}.tum", [(t, t, off_m, off_rad) for t in seconds])
    # A whole fix, a whole position without heading, and a partial fix far off that must not count.
    fixes = [(1.0, 1.0, 0.1, 0.05), (2.0, 2.0, 0.3, 0.0), (3.0, 3.0, 2.0, 1.0)]
    write_tum(folder / "vision.tum", fixes)
    cells = [
        {"outcome": "FIX", "fix_phi_rad": "0.05", "fix_sxx": "1e-4", "verdict": "FUSED"},
        {"outcome": "PARTIAL", "fix_phi_rad": "", "fix_sxx": "1e-4", "verdict": "FUSED"},
        {"outcome": "PARTIAL", "fix_phi_rad": "1.0", "fix_sxx": "4", "verdict": "REJECTED"},
    ]
    rows = [",".join(COLUMNS)]
    for (second, x, y, _), given in zip(fixes, cells, strict=True):
        row = dict.fromkeys(COLUMNS, "") | given
        row |= {"timestamp_s": f"{second:.9f}", "fix_x_m": str(x), "fix_y_m": str(y)}
        row |= {"fix_syy": row["fix_sxx"], "fix_sxy": "0"}
        rows.append(",".join(row.values()))
    (folder / "steps.csv").write_text("\n".join(rows) + "\n")
    heading = {"rmse": None if blind_truth else 1.0}
    (folder / "metrics.json").write_text(json.dumps({"odometry": {"heading_error_deg": heading}}))
    if truth:
        write_tum(folder / "truth.tum", [(t, t, 0.0, 0.0) for t in np.arange(0.0, 10.1, 0.25)])
    return folder


def by_track(folder):
    return {row.track: row for row in rows_of(read_run(folder))}


def test_errors_are_those_of_the_tracks(tmp_path):
    rows = by_track(write_run(tmp_path / "run"))
    assert rows["odometry"].position_m.median == pytest.approx(0.4)
    assert rows["odometry"].heading_deg.max == pytest.approx(math.degrees(0.2))
    assert rows["filtered"].position_m.rmse == pytest.approx(0.05)
    assert rows["smoothed"].position_m.p95 == pytest.approx(0.02)
    assert rows["filtered"].poses == 21
    assert {row.reference for row in rows.values()} == {"truth"}


def test_vision_counts_whole_fixes_and_only_measured_headings(tmp_path):
    vision = by_track(write_run(tmp_path / "run"))["vision"]
    assert vision.poses == 2
    assert vision.position_m.max == pytest.approx(0.3)
    assert vision.heading_deg.median == pytest.approx(math.degrees(0.05))


def test_without_truth_the_smoothed_track_is_the_reference_and_says_so(tmp_path):
    rows = by_track(write_run(tmp_path / "run", truth=False))
    assert {row.reference for row in rows.values()} == {"smoothed"}
    assert rows["odometry"].position_m.median == pytest.approx(0.38)
    assert rows["smoothed"].position_m == Spread()


def test_truth_without_headings_gives_no_heading_errors(tmp_path):
    rows = by_track(write_run(tmp_path / "run", blind_truth=True))
    assert rows["filtered"].heading_deg == Spread()
    assert rows["filtered"].position_m.median == pytest.approx(0.05)


def test_comparison_writes_its_files_where_it_is_told(tmp_path):
    runs = [write_run(tmp_path / "one"), write_run(tmp_path / "two", truth=False)]
    comparison = compare(runs, tmp_path / "out")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"comparison.json", "comparison.html", "comparison.rrd", "plan.svg", "plan.png"}
    content = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert [(row["run"], row["track"]) for row in content["rows"]] == [
        (row.run, row.track) for row in comparison.rows
    ]
    assert len(comparison.rows) == 8
    assert (tmp_path / "out" / "plan.png").read_bytes().startswith(b"\x89PNG")
    html = (tmp_path / "out" / "comparison.html").read_text()
    assert "two: filtered" in html
    assert "No ground truth in two" in html


def test_comparison_goes_into_the_first_run(tmp_path, monkeypatch):
    monkeypatch.setattr("runs.compare.write_comparison", lambda *_: None)
    folder = write_run(tmp_path / "run")
    assert compare([folder]).folder == folder / "compare"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("filtered.tum", "1 2 3\n", "line 1"),
        ("filtered.tum", "0 0 0 0 0 0 0 1\nx 0 0 0 0 0 0 1\n", "line 2"),
        ("steps.csv", "timestamp_s\n", "no column"),
        ("metrics.json", "{", "not JSON"),
        ("metrics.json", "[]", "expected keys"),
        ("odometry.tum", None, "no such file"),
    ],
)
def test_broken_folder_is_told_by_file_and_line(tmp_path, name, content, said):
    folder = write_run(tmp_path / "run")
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_text(content)
    with pytest.raises(InputError, match=said) as told:
        compare([folder])
    assert name in str(told.value)


def test_missing_folder_is_told(tmp_path):
    with pytest.raises(InputError, match="no such run folder"):
        compare([tmp_path / "nowhere"])


def test_run_read_back_from_a_real_one(tmp_path, toy, wireloc):
    out = tmp_path / "out"
    assert wireloc("run", toy, "--out", out).code == 0
    rows = by_track(out)
    metrics = json.loads((out / "metrics.json").read_text())
    for name in ("odometry", "vision", "filtered", "smoothed"):
        for row, told in (
            (rows[name].position_m, metrics[name]["position_error_m"]),
            (rows[name].heading_deg, metrics[name]["heading_error_deg"]),
        ):
            assert row.rmse == pytest.approx(told["rmse"], abs=1e-6)
            assert row.median == pytest.approx(told["median"], abs=1e-6)


def test_spread_leaves_out_what_is_not_known():
    assert spread(np.array([np.nan, np.nan])).rmse is None
    found = spread(np.array([1.0, np.nan, 3.0]))
    assert (found.median, found.max) == (2.0, 3.0)
    assert found.rmse == pytest.approx(math.sqrt(5.0))


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1", 10**9), ("1700000000.123456789", 1700000000123456789), ("-0.5", -500000000), (".25", 250000000)],
)
def test_seconds_become_exact_nanoseconds(text, expected):
    assert to_ns(text) == expected


def test_interpolation_goes_the_short_way_and_not_beyond():
    track = Trajectory(np.array([0, 10]), np.array([[0.0, 0.0, 3.0], [1.0, 2.0, -3.0]]))
    middle, after = interpolate(np.array([5, 11]), track)
    assert middle[:2] == pytest.approx([0.5, 1.0])
    assert abs(middle[2]) == pytest.approx(math.pi)
    assert np.isnan(after).all()


def test_infinite_heading_variance_is_no_heading():
    covariances = np.array([np.diag([1.0, 1.0, np.inf])])
    track = Trajectory(np.array([0]), np.zeros((1, 3)), covariances)
    found = errors_of(track, Trajectory(np.array([0, 1]), np.zeros((2, 3))))
    assert found.position_m.tolist() == [0.0]
    assert np.isnan(found.heading_rad).all()


def test_truth_is_read_with_its_headings(tmp_path):
    run = read_run(write_run(tmp_path / "run"))
    assert np.isfinite(run.truth.poses).all()
    assert np.isnan(run.tracks["vision"].poses[:, 2]).tolist() == [False, True, False]
