"""Sweeps: every combination once, killed and gone on with, failures told, the same on two processes."""

from __future__ import annotations

import inspect
import json
import os
import shutil
import sys
from types import SimpleNamespace

import pytest

from maps.errors import InputError
from runs import sweepmark
from runs.folderlock import sole_writer
from runs.sweep import Item, Sweep, sweep_items
from runs.sweepmark import Marks
from runs.sweepreport import failures, sweep_table
from runs.sweepstore import open_store, run_sweep, write_results


def nobody(done, total):
    """Show no progress."""


def figures(rows):
    """Return rows without times, which differ from run to run."""
    return [{name: value for name, value in row.items() if name not in ("seconds", "fix_ms")} for row in rows]


@pytest.fixture
def counted(monkeypatch):
    """Count the items that are run."""
    run = []
    before = Sweep.__call__

    def call(self, number):
        run.append(self.items[number])
        return before(self, number)

    monkeypatch.setattr(Sweep, "__call__", call)
    return run


def test_every_combination_is_an_item(toy, tmp_path):
    config = tmp_path / "fast.yaml"
    config.write_text("match_rate_hz: 1.0\n")
    items = sweep_items([toy], [config], 3, ["none", "slip"])
    assert [(item.fault, item.seed) for item in items] == [
        (fault, seed) for fault in ("none", "slip") for seed in range(3)
    ]
    assert items[0].names == {"session": "toy", "config": "fast", "fault": "none", "seed": 0}


def test_unknown_faults_and_configurations_are_refused_at_once(toy, tmp_path):
    with pytest.raises(InputError, match="flood"):
        sweep_items([toy], [], 1, ["flood"])
    (tmp_path / "bad.yaml").write_text("matchrate: 1\n")
    with pytest.raises(InputError, match="matchrate"):
        sweep_items([toy], [tmp_path / "bad.yaml"], 1, ["none"])


def test_what_is_done_is_not_done_again_and_what_changed_is(toy, tmp_path, counted):
    items = sweep_items([toy], [], 2, ["none", "slip"])
    with open_store(tmp_path / "out") as folder:
        first = run_sweep(items[:3], folder, nobody)
        # Killed here: a half-written file, and the last item missing.
        (folder / "items" / ".00003.json.part").write_text('{"row"')
        counted.clear()
        rows = run_sweep(items, folder, nobody)
    assert counted == [items[3]]
    assert rows[:3] == first
    (toy / "robot.yaml").write_text((toy / "robot.yaml").read_text() + "# changed\n")
    counted.clear()
    with open_store(tmp_path / "out") as folder:
        run_sweep(items, folder, nobody)
    assert len(counted) == 4


def test_a_result_is_known_by_all_that_it_hangs_on(toy, tmp_path, monkeypatch):
    (toy / "images").mkdir()
    picture = toy / "images" / "0.png"
    picture.write_bytes(b"12")
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "1.png").write_bytes(b"12")
    (toy / "linked").symlink_to(tmp_path / "far")
    (toy / "linked" / "back").symlink_to(toy)
    (item,) = sweep_items([toy], [], 1, ["none"])
    marks = [Marks().of(item)]
    assert Marks().of(item) == marks[0]

    def changes(what):
        marks.append(Marks().of(item))
        assert marks[-1] not in marks[:-1], what

    os.utime(picture, ns=(1, 1))
    changes("a picture changed")
    (toy / "images" / "0.png").rename(toy / "images" / "2.png")
    changes("a picture renamed")
    (tmp_path / "far" / "1.png").write_bytes(b"123")
    changes("a picture behind a link")
    (tmp_path / "map.yaml").write_text("segments: []\n")
    changes("the map one folder up")
    text = (toy / "fixes.csv").read_text()
    (toy / "fixes.csv").write_text(text.replace("0.05,0.05", "0.04,0.05"))
    changes("a table")
    monkeypatch.setattr("runs.sweepmark._program", lambda: "another estimator")
    changes("the program")


def test_the_program_is_known_by_its_source(tmp_path, monkeypatch):
    for name in ("maps", "vision", "localization", "runs"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
        module = SimpleNamespace(__file__=str(tmp_path / name / "__init__.py"))
        monkeypatch.setitem(sys.modules, name, module)
    program = inspect.unwrap(sweepmark._program)
    before = program()
    assert program() == before
    (tmp_path / "vision" / "matcher.py").write_text("GATE = 3\n")
    assert program() != before


def test_a_damaged_result_is_made_anew(toy, tmp_path, counted):
    items = sweep_items([toy], [], 1, ["none"])
    with open_store(tmp_path / "out") as folder:
        rows = run_sweep(items, folder, nobody)
        (only,) = (folder / "items").iterdir()
        only.write_text('{"fingerprint": 3')
        counted.clear()
        assert figures(run_sweep(items, folder, nobody)) == figures(rows)
    assert len(counted) == 1


def test_a_failed_item_is_told_does_not_stop_others_and_is_tried_again(toy, tmp_path, counted):
    broken = tmp_path / "broken"
    shutil.copytree(toy, broken)
    (broken / "odometry.csv").write_text("timestamp_s,left_wheel_rad,right_wheel_rad\n0,0,x\n1,1,1\n")
    items = sweep_items([broken, toy, tmp_path / "nowhere"], [], 1, ["none"])
    with open_store(tmp_path / "out") as folder:
        rows = run_sweep(items, folder, nobody)
    assert [row["status"] for row in rows] == ["failed", "ok", "failed"]
    assert "right_wheel_rad" in failures(rows)[0]
    assert [cells[4] for cells in sweep_table(rows).rows] == ["1", "0", "1"]
    counted.clear()
    with open_store(tmp_path / "out") as folder:
        run_sweep(items, folder, nobody)
    assert counted == [items[0], items[2]]


def test_a_fault_of_the_program_costs_its_item_alone(toy, monkeypatch, caplog):
    def broken(*_):
        raise ZeroDivisionError("surprise")

    monkeypatch.setattr("runs.sweep.open_session", broken)
    row = Sweep((Item(str(toy), None, None, 0),))(0)
    assert (row["status"], row["error"]) == ("failed", "ZeroDivisionError: surprise")
    assert "Traceback" in caplog.text


def test_two_processes_find_what_one_finds(toy, tmp_path):
    items = sweep_items([toy], [], 2, ["none", "jump"])
    with open_store(tmp_path / "one") as folder:
        alone = run_sweep(items, folder, nobody)
    with open_store(tmp_path / "two") as folder:
        together = run_sweep(items, folder, nobody, workers=2)
    assert figures(together) == figures(alone)


def test_a_fault_shows_in_its_row(toy, tmp_path):
    items = sweep_items([toy], [], 1, ["none", "slip"])
    with open_store(tmp_path / "out") as folder:
        right, slipped = run_sweep(items, folder, nobody)
    assert slipped["odometry_max_m"] == pytest.approx(0.5, abs=0.05)
    assert right["odometry_max_m"] < 0.01
    assert slipped["recovered_after"] is not None


def test_results_are_read_back_by_column(toy, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    items = sweep_items([toy], [], 2, ["none"])
    with open_store(tmp_path / "out") as folder:
        rows = run_sweep(items, folder, nobody)
        table = parquet.read_table(write_results(folder, rows))
    assert table.column("seed").to_pylist() == [0, 1]
    assert table.column("filtered_rmse_m").to_pylist() == [row["filtered_rmse_m"] for row in rows]


def test_one_sweep_a_folder_and_no_other_folder(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "precious").touch()
    with pytest.raises(InputError, match="not a sweep's"), open_store(tmp_path / "other"):
        pass
    (tmp_path / "out").mkdir()
    refused = pytest.raises(InputError, match="another run")
    with sole_writer(tmp_path / "out"), refused, open_store(tmp_path / "out"):
        pass


def test_the_command_writes_results_table_and_plot(wireloc, toy, tmp_path):
    pytest.importorskip("pyarrow")
    out = tmp_path / "out"
    ended = wireloc(
        "sweep", toy, "--faults", "none,slip", "--seeds", "1", "--workers", "1", "--out", out, "--json"
    )
    assert ended.code == 0
    assert [row["fault"] for row in json.loads(ended.out)] == ["none", "slip"]
    assert {path.name for path in out.iterdir()} == {
        *("items", "results.parquet", "summary.md", "sweep.png", "faults.md")
    }
    missing = wireloc("sweep", tmp_path / "nowhere", "--workers", "1", "--out", tmp_path / "none")
    assert missing.code == 1
    assert "nowhere" in missing.err


@pytest.mark.parametrize(("sessions", "entries"), [(3, 3), (22, 1)])
def test_a_plot_of_many_drives_has_colours_for_configurations_alone(sessions, entries):
    from runs.sweepreport import draw_sweep

    rows = [
        {"session": f"drive {number}", "config": "default", "fault": "none", "filtered_rmse_m": 0.01}
        for number in range(sessions)
    ]
    figure = draw_sweep(rows)
    (legend,) = figure.legends
    assert len(legend.get_texts()) == entries
    assert sum(len(line.get_xdata()) for line in figure.axes[0].lines) == sessions
