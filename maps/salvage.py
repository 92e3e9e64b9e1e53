"""What can still be read of a map that the reader refuses, and everything that it refuses in it."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from maps.documents import key_of
from maps.errors import InputError
from maps.findings import Fault, Finding, Severity
from maps.mapdocument import MapDocument

_LISTS = ("segments", "floor", "lintels")
_DROPPED = object()


def salvage(content: dict[str, Any], path: Path) -> tuple[MapDocument | None, list[Finding]]:
    """Return the sound part of a map's contents, None where it has none, and a finding for each fault.

    InputError where this is no map at all: no lists of segments and floor parts.
    """
    for key in ("segments", "floor"):
        if not isinstance(content.get(key), list):
            raise InputError(path, key, "not a map: expected a list")
    content = copy.deepcopy(content)
    findings: list[Finding] = []
    while content["segments"] and content["floor"]:
        _name_by_row(content)
        try:
            return MapDocument.model_validate(content), findings
        except ValidationError as error:
            for fault in error.errors(include_url=False, include_context=False):
                message = fault["msg"].removeprefix("Value error, ")
                findings.append(_refused(_named(content, fault["loc"]), message))
            for fault in error.errors(include_url=False, include_context=False):
                _drop(content, fault["loc"])
            for key in set(_LISTS) & content.keys():
                content[key] = [entry for entry in content[key] if entry is not _DROPPED]
    empty = [key for key in ("segments", "floor") if not content[key]]
    return None, findings or [_refused((key,), "nothing in it") for key in empty]


def _refused(where: tuple[str, ...], what: str) -> Finding:
    return Finding(Severity.ERROR, Fault.REFUSED, where, what, "correct it: as it is, the map cannot be used")


def _name_by_row(content: dict[str, Any]) -> None:
    """Name what has no name by its row in the file, which dropping others would change."""
    for key in ("segments", "lintels"):
        entries = content.get(key)
        for row, entry in enumerate(entries if isinstance(entries, list) else []):
            if isinstance(entry, dict) and entry.get("name", "") == "":
                entry["name"] = f"{key}[{row}]"


def _named(content: dict[str, Any], location: tuple[int | str, ...]) -> tuple[str, ...]:
    """Return the key of a fault, and the name of the segment or lintel that it is in."""
    match location:
        case (("segments" | "lintels") as key, int() as row, *_):
            entry = content[key][row]
            name = entry.get("name") if isinstance(entry, dict) else None
            if isinstance(name, str) and not name.startswith(f"{key}["):
                return key_of(location), name
    return (key_of(location),)


def _drop(content: dict[str, Any], location: tuple[int | str, ...]) -> None:
    """Take out the least that rids a map of a fault: an entry, a part's holes, or a key at the root."""
    match location:
        case (str() as key, int() as row, *inside):
            entry = content[key][row]
            if key == "floor" and isinstance(entry, dict) and inside[:1] != ["outer"]:
                content[key][row] = {"outer": entry.get("outer")}
            else:
                content[key][row] = _DROPPED
        case (str() as name, *_):
            for same in [key for key in content if str(key) == name]:
                del content[same]
