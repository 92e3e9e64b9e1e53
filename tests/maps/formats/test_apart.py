"""Readers in processes of their own: answers and refusals come back, ends and hangs are told in a line."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from maps.errors import InputError, MissingExtraError
from maps.formats.apart import imported_apart
from maps.formats.imported import Imported, ImportOptions


def load() -> None:
    """Nothing to load."""


def ends(path: Path, options: ImportOptions) -> Imported:  # noqa: ARG001
    os.abort()


def hangs(path: Path, options: ImportOptions) -> Imported:  # noqa: ARG001
    time.sleep(600.0)
    raise AssertionError


def grows(path: Path, options: ImportOptions) -> Imported:  # noqa: ARG001
    return bytearray(2**32)  # type: ignore[return-value]


def refuses(path: Path, options: ImportOptions) -> Imported:
    print("a library's own words")
    raise InputError(path, "line 3", f"no storey {options.storey}")


def lacks(path: Path, options: ImportOptions) -> Imported:  # noqa: ARG001
    raise MissingExtraError("needs more")


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small file; the other process finds this module."""
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    )
    monkeypatch.setattr("maps.formats.apart.SECONDS", 0.5)
    path = tmp_path / "house.ifc"
    path.write_bytes(b"ISO-10303-21;")
    return path


@pytest.mark.parametrize(
    ("reader", "what"),
    [
        ("ends", "house.ifc: damaged: the library that reads it gave up"),
        ("hangs", "house.ifc: damaged, or too large: reading it takes too long"),
        ("grows", "house.ifc: damaged, or too large: it takes too much memory"),
        ("refuses", "house.ifc: line 3: no storey Attic"),
    ],
)
def test_what_goes_wrong_is_told(house: Path, reader: str, what: str) -> None:
    with pytest.raises(InputError) as refused:
        imported_apart(f"test_apart:{reader}")(house, ImportOptions(storey="Attic"))
    assert str(refused.value).endswith(what)


def test_what_is_not_installed_is_told(house: Path) -> None:
    with pytest.raises(MissingExtraError, match=r"^needs more$"):
        imported_apart("test_apart:lacks")(house, ImportOptions())
