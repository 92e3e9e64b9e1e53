"""`wireloc experiment`: what it writes and prints, and what it says of input that is none."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from runs.experiments.judging import Category
from tests.conftest import Command

#: Enough for every table and figure, little enough for the paper's method to be quick.
SMALL = ("--images", 3, "--cases", "qi1,low_noise", "--budget", 2000)


@pytest.fixture(scope="module")
def untold(sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the sample without its truth."""
    folder = tmp_path_factory.mktemp("session") / "untold"
    shutil.copytree(sample, folder, ignore=shutil.ignore_patterns("ground_truth*"))
    return folder


def test_synthetic_writes_json_tables_figures_and_a_page(wireloc: Command, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = wireloc("experiment", "synthetic", *SMALL, "--seed", 4, "--out", out)
    assert ended.code == 0, ended.err
    content = json.loads((out / "synthetic.json").read_text())
    assert (content["images"], content["seed"]) == (3, 4)
    found = {(result["method"], result["case"]): result for result in content["results"]}
    assert list(found) == [(m, c) for c in ("qi1", "low_noise") for m in ("paper", "default")]
    for result in found.values():
        assert sum(result[category] for category in Category) == 3
        assert set(result["hypotheses"]) == {"median", "p90", "max"}
        assert set(result["ms"]) == {"median", "p90"}
        assert result["wrong_strict"] <= 3
    assert found["default", "qi1"]["recalls"] is None
    recalls = found["paper", "qi1"]["recalls"]
    assert list(recalls) == ["selection", "vertical", "unary", "binary"]
    # Where the truth is in the window every true edge is selected; two deviations lose few pairs.
    assert recalls["selection"]["share"] == 1.0
    assert all(0.7 <= stage["share"] <= 1.0 for stage in recalls.values())
    assert "Recall by stage" in ended.out
    with (out / "trials.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 12
    page = (out / "report.html").read_text()
    assert page.count("<svg") == 4
    assert 'src="http' not in page
    assert "421" in page
    assert "421" in ended.out
    assert {path.name for path in out.glob("*.png")} == {
        "errors.png",
        "hypotheses.png",
        "outcomes.png",
        "times.png",
    }


def test_results_do_not_depend_on_the_number_of_workers(wireloc: Command, tmp_path: Path) -> None:
    tables = []
    for workers in (1, 2):
        out = tmp_path / f"out{workers}"
        few = ("--images", 2, "--cases", "qi2", "--methods", "default")
        ended = wireloc("experiment", "synthetic", *few, "--workers", workers, "--out", out)
        assert ended.code == 0, ended.err
        with (out / "trials.csv").open(newline="") as file:
            tables.append([{**row, "ms": ""} for row in csv.DictReader(file)])
    assert tables[0] == tables[1]


def test_another_map_serves_and_json_is_printed(wireloc: Command, sample: Path, tmp_path: Path) -> None:
    ended = wireloc(
        *("experiment", "synthetic", "--images", 1, "--cases", "qi1", "--methods", "default", "--json"),
        *("--hall", sample / "map.yaml", "--out", tmp_path / "out"),
    )
    assert ended.code == 0, ended.err
    assert json.loads(ended.out)["results"][0]["method"] == "default"


def test_complexity_counts_and_grows(wireloc: Command, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = wireloc("experiment", "complexity", "--images", 1, "--budget", 500, "--out", out)
    assert ended.code == 0, ended.err
    assert "153,633" in ended.out
    content = json.loads((out / "complexity.json").read_text())
    assert [found["method"] for found in content["growth"]] == ["paper", "default"]
    lines = [point["lines"] for point in content["growth"][0]["points"]]
    assert lines == sorted(lines)
    assert lines[-1] - lines[0] == 55
    counts = content["counts"][0]
    assert counts["log10_product"] >= counts["log10_two_trees"]
    assert (out / "search_space.png").exists()


def test_a_session_frame_by_frame(wireloc: Command, sample: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = wireloc("experiment", "session", sample, "--images", 3, "--methods", "default", "--out", out)
    assert ended.code == 0, ended.err
    content = json.loads((out / "session.json").read_text())
    assert (content["session"], content["images"], len(content["rows"])) == ("building_a", 3, 3)
    result = content["results"][0]
    assert result["fixes"] + result["partial"] + result["ambiguous"] + result["no_fix"] == 3
    assert {row["outcome"] for row in content["rows"]} <= {"FIX", "PARTIAL", "AMBIGUOUS", "NO_FIX"}
    assert "391" in ended.out  # the paper's last row


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("synthetic", "--methods", "best"), "best is not among paper, default"),
        (("synthetic", "--cases", "qi1,qi9"), "qi9 is not among qi1"),
        (("synthetic", "--hall", "nowhere.yaml"), "nowhere.yaml"),
        (("session", "nowhere"), "nowhere"),
    ],
)
def test_bad_input_is_told_in_one_line(
    wireloc: Command, arguments: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    ended = wireloc("experiment", *arguments, "--out", tmp_path / "out")
    assert ended.code == 2
    assert told in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_session_without_truth_is_refused(wireloc: Command, untold: Path, tmp_path: Path) -> None:
    ended = wireloc("experiment", "session", untold, "--out", tmp_path / "out")
    assert ended.code == 2
    assert "ground_truth.csv" in ended.err


def test_a_floor_without_room_is_refused(wireloc: Command, tmp_path: Path) -> None:
    narrow = tmp_path / "narrow.yaml"
    narrow.write_text(
        "units: m\nsegments: [{p0: [0, 0, 0], p1: [9, 0, 0]}]\n"
        "floor: [{outer: [[0, 0], [9, 0], [9, 0.8], [0, 0.8]]}]\n"
    )
    ended = wireloc("experiment", "synthetic", "--hall", narrow, "--out", tmp_path / "out")
    assert ended.code == 2
    assert "floor" in ended.err


def test_a_folder_that_holds_something_is_left_alone(wireloc: Command, tmp_path: Path) -> None:
    (tmp_path / "note").write_text("mine")
    ended = wireloc("experiment", "synthetic", *SMALL, "--out", tmp_path)
    assert ended.code == 2
    assert (tmp_path / "note").read_text() == "mine"
