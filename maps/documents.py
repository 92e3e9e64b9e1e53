"""YAML documents read safely and checked against a model, with errors that name file and key."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from maps.errors import InputError

#: Larger than any map that a person or an importer writes; smaller than what would hurt.
MAX_BYTES = 64 * 2**20
#: Deeper than anything that is meant.
MAX_DEPTH = 50

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

T = TypeVar("T")


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """Return a text file's contents; InputError where it is missing, too large or not UTF-8."""
    try:
        if path.stat().st_size > max_bytes:
            raise InputError(path, "", f"larger than {max_bytes // 2**20} MB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(path, "", "no such file") from None
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "not UTF-8 text") from None
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Return a YAML file's mapping; InputError names the line of what cannot be read.

    Only plain data is built. Aliases are refused: a few lines of them can stand for gigabytes. So
    are tags and endless nesting, at which the loader itself falls over.
    """
    text = read_text(path)
    try:
        _refuse_tricks(text, path)
        content = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        what = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(path, f"line {mark.line + 1}" if mark else "", f"not YAML: {what}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"not YAML: {error}") from None
    if not isinstance(content, dict):
        raise InputError(path, "", "expected keys and values")
    return content


def _refuse_tricks(text: str, path: Path) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent):
            what = "YAML aliases are not supported"
        elif getattr(event, "tag", None):
            what = "YAML tags are not supported"
        elif depth > MAX_DEPTH:
            what = "nested too deeply"
        else:
            continue
        mark: Any = event.start_mark
        raise InputError(path, f"line {mark.line + 1}", what)


def checked(model: type[T], content: Any, path: Path | str) -> T:
    """Return content as `model`; InputError names the first key that does not fit."""
    try:
        return TypeAdapter(model).validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        message = first["msg"].removeprefix("Value error, ")
        raise InputError(path, key_of(first["loc"]), message[:1].lower() + message[1:]) from None


def key_of(location: tuple[int | str, ...]) -> str:
    """Write a place in a document as people do: `segments[3].p0[1]`."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else (f".{part}" if key else part)
    return key
