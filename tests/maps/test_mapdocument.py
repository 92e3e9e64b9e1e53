"""map.yaml written: it reads back the same, and keeps what it does not know."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from toy_building import toy_building

from maps.mapdocument import DECIMALS, MapDocument, read_document, write_map, write_whole
from maps.mapfile import read_map

SIZES = st.floats(-1e4, 1e4, allow_nan=False)


def test_a_written_map_reads_back_the_same(tmp_path: Path) -> None:
    original = toy_building().read(tmp_path)
    write_map(tmp_path / "copy.yaml", read_document(tmp_path / "map.yaml"))
    copy = read_map(tmp_path / "copy.yaml")
    np.testing.assert_allclose(copy.endpoints, original.endpoints, atol=0.6 * 10**-DECIMALS)
    assert (copy.names, copy.kinds) == (original.names, original.kinds)
    assert copy.floor.symmetric_difference(original.floor).area < 1e-3
    np.testing.assert_array_equal(copy.wall_tops_m, original.wall_tops_m)
    np.testing.assert_array_equal(copy.lintel_bottoms_m, original.lintel_bottoms_m)


def test_unknown_keys_and_learnt_fields_are_kept_and_points_are_on_one_line(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(
        "building: old mill\nsegments:\n"
        "- {name: a, kind: floor, p0: [0, 0, 0], p1: [1, 0, 0], sigma_m: 0.02, polarity: -1, colour: red,"
        " detection_rate: 0.4}\n"
        "floor: [{outer: [[0, 0], [2, 0], [0, 2]]}]\n"
        "lintels: [{p0: [0, 0], p1: [1, 0], bottom_m: 2, by: me}]\nsurvey: {year: 1999}\n"
    )
    write_map(tmp_path / "out" / "copy.yaml", read_document(path))
    text = (tmp_path / "out" / "copy.yaml").read_text()
    for kept in (
        "building: old mill",
        "colour: red",
        "by: me",
        "year: 1999",
        "sigma_m: 0.02",
        "polarity: -1",
    ):
        assert kept in text
    assert "detection_rate: 0.4" in text
    assert "p1: [1.0, 0.0, 0.0]" in text
    assert read_document(tmp_path / "out" / "copy.yaml") == read_document(path)


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(ends=st.lists(st.tuples(SIZES, SIZES, SIZES), min_size=2, max_size=2, unique=True), name=st.text())
def test_any_coordinates_and_names_survive(
    tmp_path: Path, ends: list[tuple[float, float, float]], name: str
) -> None:
    if np.abs(np.subtract(*ends)).max() < 1e-3:
        return
    content = {
        "segments": [{"name": name, "p0": ends[0], "p1": ends[1]}],
        "floor": [{"outer": [(0, 0), (1, 0), (0, 1)]}],
    }
    document = MapDocument.model_validate(content)
    write_map(tmp_path / "map.yaml", document)
    segment = read_document(tmp_path / "map.yaml").segments[0]
    assert segment.name == name
    np.testing.assert_allclose([segment.p0, segment.p1], ends, atol=0.6 * 10**-DECIMALS)


def test_a_write_that_fails_leaves_the_old_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.yaml"
    path.write_text("old")
    document = MapDocument.model_validate(
        {"segments": [{"p0": (0, 0, 0), "p1": (1, 0, 0)}], "floor": [{"outer": [(0, 0), (1, 0), (0, 1)]}]}
    )

    def full(*_: Path) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="no space left"):
        write_map(path, document)
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.yaml"]
    assert path.read_text() == "old"


def test_a_write_that_fails_leaves_what_was_there_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.yaml"
    write_whole(path, b"whole")

    def full(self: Path, content: bytes) -> None:
        with self.open("wb") as file:
            file.write(content[:2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(path, b"another")
    assert path.read_bytes() == b"whole"
    assert [one.name for one in tmp_path.iterdir()] == ["map.yaml"]
