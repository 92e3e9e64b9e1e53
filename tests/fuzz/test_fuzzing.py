"""A short campaign of every reader, the same each time, and what longer ones have found."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaign import campaign, tried
from mutations import mutated
from readers import Reader, readers

READERS = {reader.name: reader for reader in readers()}

#: What was once taken badly: the reader, and how its good file is changed.
FOUND: list[tuple[str, Callable[[bytes], bytes]]] = [
    ("frames", lambda good: good.replace(b"images/000000", b"images/" + b"0" * 5000)),
    ("frames", lambda good: good.replace(b"images/000000.jpg", b"../images/000000.jpg")),
    ("trajectory", lambda good: good.replace(b"0.100000000", b"9" * 25)),
    ("steps", lambda good: good.replace(b"a.jpg", b"a" * 200_000)),
    ("lines", lambda good: good.replace(b"4,3,0", b"4,1e308,0")),
    ("euroc's camera", lambda good: good.replace(b"0.98006658", b"1e308")),
    ("bag metadata", lambda good: good.replace(b"bag.db3", b"../../robot.yaml")),
    ("bag metadata", lambda good: good.replace(b"message_count: 4", b"message_count: ''")),
    ("bag db3", lambda good: good.replace(b"uint32 width", b"uint32 breit")),
    ("tum", lambda good: good.replace(b"rgb/a.jpg", b"/etc/hostname")),
    ("euroc", lambda good: good.replace(b"a.jpg", b"../../../robot.yaml")),
    ("grid's yaml", lambda good: good.replace(b"0.05", b"1e-10")),
    ("ifc here", lambda good: good.replace(b"IFCRELFILLSELEMENT", b"IFCRELFILLSELEMENT($,$);IFCWALL")),
    ("ifc here", lambda good: good.replace(b"FILE_SCHEMA(('IFC4", b"FILE_SCHEMA(('IF" + b"." * 1000)),
    ("ifc here", lambda good: good.replace(b"500.", b"#1")),
    ("ifc here", lambda good: good.replace(b".METRE.", b"$")),
]


@pytest.fixture(scope="module")
def laid(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder for each reader, laid out."""
    folders = {}
    for name, reader in READERS.items():
        folders[name] = tmp_path_factory.mktemp("fuzz")
        reader.lay(folders[name])
    return folders


@pytest.mark.parametrize("name", READERS)
def test_a_good_file_is_read(name: str, laid: dict[str, Path]) -> None:
    reader = READERS[name]
    (laid[name] / reader.file).write_bytes(reader.seeds[0])
    reader.read(laid[name])


@pytest.mark.parametrize("name", READERS)
def test_a_broken_file_is_refused_or_read(name: str, laid: dict[str, Path]) -> None:
    reader = READERS[name]
    for seed in range(reader.tries):
        data = mutated(reader.seeds, np.random.default_rng(seed))
        assert tried(reader, data, laid[name]) is None, seed


@pytest.mark.parametrize(("name", "change"), FOUND)
def test_what_was_found_stays_mended(
    name: str, change: Callable[[bytes], bytes], laid: dict[str, Path]
) -> None:
    if name not in READERS:
        pytest.skip("needs a library that is not installed")
    reader = READERS[name]
    data = change(reader.seeds[0])
    assert data != reader.seeds[0]
    assert tried(reader, data, laid[name]) is None


def test_a_campaign_finds_what_is_broken_and_keeps_the_input(tmp_path: Path) -> None:
    def careless(folder: Path) -> None:
        float((folder / "camera").read_bytes()[:2])

    reader = replace(READERS["camera info"], name="careless", file="camera", read=careless, seeds=(b"1",))
    tries, findings = campaign(reader, 0.5, 1, tmp_path)
    assert tries > 10
    assert any(what.startswith("ValueError at test_fuzzing.py") for what in findings)
    assert list(tmp_path.glob("careless-*"))


def test_a_hang_is_found(tmp_path: Path) -> None:
    reader = Reader("slow", "file", (b"1",), lambda _: time.sleep(2.0), most_s=0.05)
    assert (tried(reader, b"1", tmp_path) or "").startswith("longer than 0.05 s")
