"""Plain lists of lines: forms, floors found and guessed, bad lines."""

from __future__ import annotations

import pytest

from maps.errors import InputError
from maps.formats.imported import ImportOptions
from maps.formats.line_list import import_lines
from maps.mapfile import build_map

SQUARE = [(0, 0), (6, 0), (6, 4), (0, 4)]
PILLAR = [(2, 1), (3, 1), (3, 2), (2, 2)]


def loop(corners, z=0.0):
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return [f"{p[0]} {p[1]} {z} {q[0]} {q[1]} {z}" for p, q in pairs]


def uprights(corners, top=2.5):
    return [f"{x},{y},0,{x},{y},{top}" for x, y in corners]


def imported(folder, lines, options=ImportOptions()):  # noqa: B008
    path = folder / "lines.txt"
    path.write_text("\n".join(lines) + "\n")
    return import_lines(path, options)


def test_a_room_with_a_pillar(tmp_path):
    lines = [
        "# survey",
        "x0 y0 z0 x1 y1 z1",
        *loop(SQUARE),
        *loop(PILLAR),
        "",
        *uprights(SQUARE),
        *loop(SQUARE, 2.5),
    ]
    result = imported(tmp_path, lines)
    wire_map = build_map(result.document, tmp_path)
    assert wire_map.floor.area == pytest.approx(23.0)
    assert len(wire_map) == 16
    assert result.report.found["vertical_lines"] == 4
    assert any("enclose" in sentence for sentence in result.report.guessed)


def test_lines_drawn_twice_or_in_pieces_are_one(tmp_path):
    lines = [*loop(SQUARE), *loop(SQUARE), "0 0 0 3 0 0", "0;0;0;0;0;2.5;corner a", "0 0 2.4 0 0 2.6"]
    result = imported(tmp_path, lines)
    assert len(result.document.segments) == 5
    assert "corner a" in {segment.name for segment in result.document.segments}
    assert len(result.report.dropped) == 1


def test_the_floor_of_lines_that_do_not_close_is_around_them_and_said(tmp_path):
    result = imported(tmp_path, [*loop(SQUARE)[:2], *uprights(SQUARE)])
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(24.0)
    assert any("rectangle" in sentence for sentence in result.report.guessed)


def test_the_largest_of_two_floors_is_kept(tmp_path):
    result = imported(tmp_path, [*loop(SQUARE), *loop([(10, 0), (14, 0), (14, 3), (10, 3)])])
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(24.0)
    assert any("cannot be reached" in sentence for sentence in result.report.dropped)


def test_a_unit_scales_everything(tmp_path):
    lines = [" ".join(str(float(word) * 1000) for word in line.split()) for line in loop(SQUARE)]
    result = imported(tmp_path, lines, ImportOptions(unit_m=1e-3))
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(24.0)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["0 0 0 1 0"], "line 1: expected six numbers"),
        (["0 0 0 1 0 0", "0 0 0 1 0 nan"], "line 2"),
        (["0 0 0 1 0 0", "a b c d e f"], "line 2"),
        (["# nothing"], "no lines"),
        (["0 0 0 0 0 0"], "no line with a length"),
        (["0 0 0 0 0 2"], "no floor"),
        (["0 0 0 9e9 0 0", "0 0 0 0 1 0"], "segments[0].p1[0]"),
    ],
)
def test_bad_lists_name_their_line(tmp_path, lines, said):
    with pytest.raises(InputError) as caught:
        imported(tmp_path, lines)
    assert said in str(caught.value)
