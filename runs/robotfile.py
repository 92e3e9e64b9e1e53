"""Writing into a copy of robot.yaml: what was estimated changes, the rest stays, comments and all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from maps.documents import read_text, read_yaml
from maps.errors import InputError

#: What a camera's block lacks where nobody has measured it; the reader asks for it by its name.
MOUNT = """\
  # Measure these, then take the leading '# ' away.
  # mount: # where the camera sits: x forward, y left of the middle between the wheels
  #   x_m: 0.0
  #   y_m: 0.0
  #   height_m: 1.0 # above the floor
  #   pitch_down_rad: 0.0 # looking down is positive
  #   yaw_rad: 0.0 # looking left is positive
  #   roll_rad: 0.0
"""


def with_camera(source: Path | None, camera: dict[str, Any]) -> str:
    """Return a robot file's text with these keys of its camera set, or taken out where they are None.

    A file without a camera, or no file, gets one whose mount is left to be filled in. InputError where the
    file cannot be read.
    """
    text = read_text(source) if source else ""
    content = read_yaml(source).get("camera") if source else None
    if source is not None and not isinstance(content, dict | None):
        raise InputError(source, "camera", "expected keys and values")
    edited = with_block(text, "camera", camera)
    if "mount" in (content or {}):
        return edited
    end = _end(_entry(_composed(edited), "camera")[1])
    return f"{edited[:end]}\n{MOUNT.rstrip()}{edited[end:]}"


def with_block(text: str, block: str, values: dict[str, Any]) -> str:
    """Return YAML text with keys of one top-level block set, or taken out where the value is None.

    Everything else, comments included, is left as it is; only what is written in braces is written anew.
    """
    root = _composed(text)
    if root is None or root.flow_style:
        # Braces around the whole file: nothing of it is worth keeping but its values.
        content = yaml.safe_load(text) or {}
        others = [_line(key, value) + "\n" for key, value in content.items() if key != block]
        return "".join([*others, _block(block, (content.get(block) or {}) | values)])
    if not _has(root, block):
        return f"{text.rstrip()}\n\n{_block(block, values)}"
    key, value = _entry(root, block)
    start, end = key.start_mark.index, _end(value)
    if isinstance(value, yaml.MappingNode) and not value.flow_style:
        start, (written, end) = value.start_mark.index, _rewritten(text, value, values)
    else:
        written = _block(block, (yaml.safe_load(text)[block] or {}) | values).rstrip()
    return text[:start] + written + text[end:]


def with_keys(text: str, path: tuple[str, ...], values: dict[str, Any]) -> str:
    """Return YAML text with keys set in a mapping inside mappings, all the rest as it is.

    `path`: the keys that lead there, at most one of them missing; empty for the whole file, which gets new keys at
    its end.
    """
    node: Any = _composed(text)
    for depth, key in enumerate(path):
        if node is None or not _has(node, key):
            return with_keys(text, path[:depth], {key: values})
        node = _entry(node, key)[1]
    if not isinstance(node, yaml.MappingNode):
        if path:
            return with_keys(text, path[:-1], {path[-1]: values})
        return "".join(_line(key, value) + "\n" for key, value in values.items())
    if node.flow_style:
        merged = yaml.safe_load(text[node.start_mark.index : _end(node)]) | values
        written: str = yaml.safe_dump(merged, default_flow_style=True, allow_unicode=True, width=10**6)
        return text[: node.start_mark.index] + written.strip() + text[_end(node) :]
    if not path and not any(_has(node, key) for key in values):
        return f"{text.rstrip()}\n" + "".join(_line(key, value) + "\n" for key, value in values.items())
    written, end = _rewritten(text, node, values)
    return text[: node.start_mark.index] + written + text[end:]


def _rewritten(text: str, node: yaml.MappingNode, values: dict[str, Any]) -> tuple[str, int]:
    """Return a block mapping's new text, from its first key on, and where the old one ended.

    New keys go on the lines below the one that `values` has before them.
    """
    pad = " " * node.start_mark.column
    entries = _entries(text, node)
    order, previous = list(entries), None
    for key, value in values.items():
        if key not in entries:
            order.insert(0 if previous is None else order.index(previous) + 1, key)
            above = entries[previous] if previous is not None else _Entry("", "", "")
            entries[key] = _Entry("", "", above.below)
            if previous is not None:
                entries[previous] = replace(above, below="")
        line = "" if value is None else _line(key, value)
        entries[key] = replace(entries[key], line=line)
        previous = key
    lines = [
        (f"{pad}{entry.line}{entry.comment}\n" if entry.line else "") + entry.below
        for entry in (entries[name] for name in order)
    ]
    end = _line_end(text, _end(node))
    return "".join(lines).removeprefix(pad).removesuffix("\n"), end


@dataclass(frozen=True, slots=True)
class _Entry:
    """A key with its value, the comment behind it, and the lines between it and the next key."""

    line: str
    comment: str
    below: str


def _entries(text: str, node: yaml.MappingNode) -> dict[str, _Entry]:
    """Cut a block mapping's text into its entries, by their keys."""
    column = node.start_mark.column
    starts = [key.start_mark.index for key, _ in node.value]
    stops = [*(start - column for start in starts[1:]), _line_end(text, _end(node))]
    entries = {}
    for (key, value), start, stop in zip(node.value, starts, stops, strict=True):
        line = text[start : _end(value)].rstrip()
        comment, _, below = text[start + len(line) : stop].partition("\n")
        entries[key.value] = _Entry(line, comment, below)
    return entries


def _composed(text: str) -> Any:
    """Return the document's mapping node with the places of all its parts; None where it is empty."""
    return yaml.compose(text, Loader=yaml.SafeLoader)


def _has(node: yaml.MappingNode, key: str) -> bool:
    return any(name.value == key for name, _ in node.value)


def _entry(node: yaml.MappingNode, key: str) -> tuple[yaml.Node, yaml.Node]:
    """Return the nodes of a key and its value: the last ones, as the loader takes them."""
    name, value = [pair for pair in node.value if pair[0].value == key][-1]
    return name, value


def _end(node: yaml.Node) -> int:
    """Return where a node's text ends; a block's own end lies behind the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _line_end(text: str, place: int) -> int:
    end = text.find("\n", place)
    return len(text) if end < 0 else end


def _block(name: str, content: Mapping[str, Any]) -> str:
    lines = [f"  {_line(key, value)}\n" for key, value in content.items() if value is not None]
    return f"{name}:\n{''.join(lines)}"


def _line(key: str, value: Any) -> str:
    """Write a key and its value on one line."""
    text: str = yaml.safe_dump({key: value}, default_flow_style=True, allow_unicode=True, width=10**6)
    return text.strip()[1:-1]
