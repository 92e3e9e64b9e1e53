"""The table of faults: runs gathered by kind, compared with the undisturbed one, and held against what must hold."""

from __future__ import annotations

import pytest

from runs.faults.table import fault_table, shortfalls


def row(fault, session="hall", seed=0, **other):
    """Make a sweep's row of a run that went well."""
    return {
        "session": session,
        "config": "default",
        "fault": fault,
        "seed": seed,
        "status": "ok",
        "error": None,
        "filtered_rmse_m": 0.02,
        "filtered_max_m": 0.1,
        "tracking_s": 30.0,
        "uncertain_s": 9.0,
        "lost_s": 1.0,
        "tracking_wrong_s": 0.0,
        "wrong_settled_s": 0.0,
        "recovered_after": 1,
        "looks_after": 20,
        "lost_after": None,
        "astray": None,
        "wrong": 2,
        "wrong_accepted": 0,
        **other,
    }


GOOD = [row("none"), row("none", seed=1), row("slip", filtered_rmse_m=0.03), row("wrong-map", lost_after=10)]


def test_runs_are_gathered_by_kind_and_compared_with_their_own_undisturbed_one():
    rows = [
        row("none", filtered_rmse_m=0.01),
        row("none", session="room", filtered_rmse_m=0.02),
        row("slip", filtered_rmse_m=0.03, recovered_after=7),
        row("slip", session="room", filtered_rmse_m=0.02, lost_after=4, astray=3, wrong_accepted=3),
    ]
    grid = fault_table(rows)
    assert [cells[0] for cells in grid.rows] == ["none", "slip"]
    told = dict(zip(grid.header, grid.rows[1], strict=True))
    assert told["runs"] == "2"
    assert told["RMSE m"] == "0.025"
    assert (told["to none"], told["worst"]) == ("2.0", "3.0")
    assert told["TRACKING, UNCERTAIN, LOST"] == "75 %, 22 %, 2 %"
    assert (told["recovered ≤ 5"], told["slowest"]) == ("1 of 2", "7")
    assert (told["LOST after"], told["astray"]) == ("4 to 4, 1", "3 to 3")
    assert (told["wrong fixes"], told["accepted"]) == ("4", "3")


def test_a_fault_without_an_end_has_no_recovery():
    told = dict(zip(fault_table(GOOD).header, fault_table(GOOD).rows[-1], strict=True))
    assert (told["fault"], told["recovered ≤ 5"], told["slowest"]) == ("wrong-map", "-", "-")


def test_runs_that_cannot_tell_are_left_out_of_both_numbers_and_told():
    unseen = row("slip", session="yard", recovered_after=None, looks_after=0)
    short = row("slip", session="yard", seed=1, recovered_after=None, looks_after=4)
    rows = [*GOOD, row("slip", session="room", recovered_after=6), unseen, short]
    told = dict(zip(fault_table(rows).header, fault_table(rows).rows[1], strict=True))
    assert (told["fault"], told["runs"]) == ("slip", "4")
    assert (told["recovered ≤ 5"], told["slowest"]) == ("1 of 2, 2 untold", "6")
    (line,) = shortfalls(rows)
    assert "after 6 observable" in line


def test_five_looks_without_a_right_one_are_a_failure_and_a_right_one_among_fewer_is_none():
    short = row("slip", seed=1, recovered_after=2, looks_after=2)
    never = row("slip", seed=2, recovered_after=None, looks_after=5)
    told = dict(zip(fault_table([short, never]).header, fault_table([short, never]).rows[0], strict=True))
    assert (told["recovered ≤ 5"], told["slowest"]) == ("1 of 2", "never")
    (line,) = shortfalls([short, never])
    assert "seed 2" in line
    assert "after no number of" in line
    # One that failed has told nothing, and that is no excuse.
    broken = row("slip", seed=3, status="failed", error="x", recovered_after=None, looks_after=None)
    assert fault_table([short, broken]).rows[0][9] == "1 of 2"


def test_runs_that_hold_are_no_shortfall():
    assert shortfalls(GOOD) == []


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (row("slip", status="failed", error="ZeroDivisionError: x"), "failed: ZeroDivisionError"),
        (row("late", wrong_settled_s=0.4), "0.4 s after three"),
        (row("jump", recovered_after=6), "after 6 observable"),
        (row("blocked", recovered_after=None), "after no number of"),
        (row("wrong-map", lost_after=11), "LOST after 11"),
        (row("wrong-map: another"), "LOST after no number"),
        (row("map-moved", filtered_rmse_m=0.05), "2.5 times"),
    ],
)
def test_what_does_not_hold_is_told_in_a_line(bad, words):
    (line,) = shortfalls([*GOOD, bad])
    assert words in line
    assert str(bad["fault"]) in line


def test_being_wrong_on_a_wrong_map_is_not_charged_twice():
    assert shortfalls([row("none"), row("wrong-map", lost_after=3, wrong_settled_s=2.0)]) == []
