"""YAML from strangers: read safely, refused in one line that names the place."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from pydantic import BaseModel

from maps.documents import MAX_BYTES, checked, key_of, read_text, read_yaml
from maps.errors import InputError


class Part(BaseModel):
    size: float


class Whole(BaseModel):
    parts: list[Part]


def refused(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    return caught.value


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "document.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_plain_mapping_is_read_with_or_without_a_byte_order_mark(tmp_path: Path) -> None:
    for mark in (b"", b"\xef\xbb\xbf"):
        assert read_yaml(written(tmp_path, mark + b"a: [1, 2.5, null]\nb: {c: x*y}\n")) == {
            "a": [1, 2.5, None],
            "b": {"c": "x*y"},
        }


def test_alias_bomb_is_refused_at_once(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    started = time.perf_counter()
    error = refused(written(tmp_path, "\n".join(lines)))
    assert time.perf_counter() - started < 1.0
    assert error.where == "line 2"
    assert "alias" in error.what


@pytest.mark.parametrize("text", ["a: [1, 2\n", "a: 1\n  b: {\n", "\t- x\n", "a: b: c\n", "a: '\n"])
def test_broken_yaml_names_a_line(tmp_path: Path, text: str) -> None:
    error = refused(written(tmp_path, text))
    assert error.where.startswith("line ")
    assert error.what.startswith("not YAML")


@pytest.mark.parametrize("text", ["", "- 1\n- 2\n", "just words\n", "3.5\n", "# nothing\n"])
def test_what_is_not_a_mapping_is_refused(tmp_path: Path, text: str) -> None:
    assert refused(written(tmp_path, text)).what == "expected keys and values"


def test_objects_are_not_built(tmp_path: Path) -> None:
    error = refused(written(tmp_path, "a: !!python/object/apply:os.system ['true']\n"))
    assert (error.where, error.what) == ("line 1", "YAML tags are not supported")


@pytest.mark.parametrize("opening", ["[", "{a: ", "- "])
def test_deep_nesting_is_refused(tmp_path: Path, opening: str) -> None:
    assert refused(written(tmp_path, "a:\n  " + opening * 100_000)).what == "nested too deeply"


def test_a_date_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    assert refused(written(tmp_path, "a: 2020-13-45\n")).what.startswith("not YAML")


@pytest.mark.parametrize("value", ["!!timestamp x", "!!bool x", "!!int x", "!own {}"])
def test_tags_are_refused(tmp_path: Path, value: str) -> None:
    error = refused(written(tmp_path, f"b: 1\na: {value}\n"))
    assert (error.where, error.what) == ("line 2", "YAML tags are not supported")


def test_text_in_another_encoding_is_refused(tmp_path: Path) -> None:
    error = refused(written(tmp_path, "name: Büro\n".encode("latin-1")))
    assert (error.where, error.what) == ("byte 7", "not UTF-8 text")


def test_control_characters_are_refused(tmp_path: Path) -> None:
    assert "control characters are not allowed" in refused(written(tmp_path, b"a: \x00\x01\n")).what


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert refused(tmp_path / "none.yaml").what == "no such file"
    assert refused(tmp_path).what


def test_too_large_a_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "document.yaml"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert "larger than 64 MB" in refused(path).what
    with pytest.raises(InputError, match="larger than"):
        read_text(written(tmp_path, "12345"), max_bytes=4)


def test_the_key_that_does_not_fit_is_named() -> None:
    with pytest.raises(InputError) as caught:
        checked(Whole, {"parts": [{"size": 1.0}, {"size": "big"}]}, "some.yaml")
    assert caught.value.where == "parts[1].size"
    assert str(caught.value).startswith("some.yaml: parts[1].size: input should be")


def test_keys_are_written_as_people_do() -> None:
    assert key_of(("segments", 3, "p0", 1)) == "segments[3].p0[1]"
    assert key_of(()) == ""
