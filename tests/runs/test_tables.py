"""CSV tables: what is read exactly, and what is refused by file, line and column."""

from pathlib import Path

import numpy as np
import pytest

from maps.errors import InputError
from runs.tables import read_table


def table(tmp_path: Path, text: str):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    return read_table(path)


def test_times_are_exact_to_the_nanosecond(tmp_path):
    read = table(tmp_path, "timestamp_s,v\n1700000000.123456789,1\n1700000000.123456790,2\n")
    assert read.times().tolist() == [1_700_000_000_123_456_789, 1_700_000_000_123_456_790]


def test_blank_lines_spaces_and_byte_order_mark_do_no_harm(tmp_path):
    read = table(tmp_path, "\ufefftimestamp_s, v\n\n0.5 , 2\n")
    assert read.numbers("v").tolist() == [2.0]
    assert read.lines == (3,)


def test_empty_cell_is_nan_only_where_allowed(tmp_path):
    read = table(tmp_path, "timestamp_s,v\n0,\n")
    assert np.isnan(read.numbers("v", may_be_empty=True)).all()
    with pytest.raises(InputError, match="line 2: v: empty"):
        read.numbers("v")


@pytest.mark.parametrize("text", ["", "\n\n", "timestamp_s,v\n"])
def test_no_rows(tmp_path, text):
    with pytest.raises(InputError, match=r"rows\.csv: no rows"):
        table(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("timestamp_s,v\n0,1\n1\n", "line 3: 1 cells under a header of 2"),
        ("v,v\n0,1\n", "line 1: a column name is there twice"),
        ('timestamp_s,v\n0,"1\n', "line 2: not CSV"),
    ],
)
def test_malformed_table(tmp_path, text, where):
    with pytest.raises(InputError, match=where):
        table(tmp_path, text)


@pytest.mark.parametrize("cell", ["x", "nan", "inf", "-inf", "1e999999999", "sNaN", "1e30", "", "0x10"])
def test_not_a_finite_number(tmp_path, cell):
    read = table(tmp_path, f"timestamp_s,v\n0,0\n1,{cell}\n")
    with pytest.raises(InputError, match="line 3: v: "):
        read.numbers("v")
    with pytest.raises(InputError, match="line 3: v: "):
        read.times("v")


def test_times_may_not_run_backwards(tmp_path):
    with pytest.raises(InputError, match="line 4: timestamp_s runs backwards"):
        table(tmp_path, "timestamp_s\n0\n2\n1\n").times(may_repeat=True)


def test_times_repeat_only_where_allowed(tmp_path):
    read = table(tmp_path, "timestamp_s\n0\n0\n")
    assert read.times(may_repeat=True).tolist() == [0, 0]
    with pytest.raises(InputError, match="line 3: timestamp_s repeats"):
        read.times()


def test_missing_column_and_missing_file(tmp_path):
    with pytest.raises(InputError, match="line 1: no column timestamp_s"):
        table(tmp_path, "v\n1\n").times()
    with pytest.raises(InputError, match=r"nothing\.csv: no such file"):
        read_table(tmp_path / "nothing.csv")


def test_arrival_is_the_stamp_unless_told(tmp_path):
    assert (arrivals := table(tmp_path, "timestamp_s\n1\n2\n")).arrivals(arrivals.times()).tolist() == [
        1_000_000_000,
        2_000_000_000,
    ]


def test_arrivals_may_disorder_rows_but_not_precede_stamps(tmp_path):
    read = table(tmp_path, "timestamp_s,arrival_s\n1,3\n2,2\n")
    assert read.arrivals(read.times()).tolist() == [3_000_000_000, 2_000_000_000]
    read = table(tmp_path, "timestamp_s,arrival_s\n1,3\n2,1.9\n")
    with pytest.raises(InputError, match="line 3: arrival_s is before timestamp_s"):
        read.arrivals(read.times())
