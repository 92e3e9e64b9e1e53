"""Broken inputs from good ones: bytes, numbers, words and lines changed, lost, doubled or put elsewhere."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

#: What breaks readers: limits of number types, other notations, structure of every format here.
TOKENS = [
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"0", b"-1", b"1e5000", b"0x10", b"1_000"),
    *(b"9" * 25, b"4294967296", b"2147483648", b"65537", b"-0.0", b"", b" ", b"null", b"true", b"~", b"[]"),
    *(b"{}", b"[[[[", b"]]]]", b"{{{{", b"!!python/object:os.system", b"&a [*a]", b"*a", b"<<: {}", b"'"),
    *(b'"', b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n", b",", b",,,,", b";", b"#", b"../../etc"),
    *(b"/etc/passwd", b"..", b"$", b"#1=", b"IFCWALL($)", b"LINE", b"ENDSEC", b"EOF", b"<a>", b"]]>", b"&x;"),
    "\u0661\u00bd\u2460".encode(),
]
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]\w+")

Mutation = Callable[[bytes, np.random.Generator], bytes]


def mutated(seeds: Sequence[bytes], rng: np.random.Generator) -> bytes:
    """Return a seed with one change, or some."""
    data = seeds[int(rng.integers(len(seeds)))]
    for _ in range(int(rng.geometric(0.5))):
        change = MUTATIONS[int(rng.integers(len(MUTATIONS)))]
        data = change(data, rng)
    return data[: 2**20]


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with some flipped, or a part of them lost."""
    return (_bits, _cut, _lost)[int(rng.integers(3))](data, rng)


def _replaced(pattern: re.Pattern[bytes], data: bytes, rng: np.random.Generator) -> bytes:
    found = list(pattern.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    return data[: one.start()] + _token(rng) + data[one.end() :]


def _token(rng: np.random.Generator) -> bytes:
    return TOKENS[int(rng.integers(len(TOKENS)))]


def _number(data: bytes, rng: np.random.Generator) -> bytes:
    return _replaced(_NUMBER, data, rng)


def _scaled(data: bytes, rng: np.random.Generator) -> bytes:
    """Multiply a number."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    value = float(one.group()) * float(rng.choice([-1.0, 0.0, 1e-9, 1e3, 1e9, 1e15]))
    return data[: one.start()] + repr(value).encode() + data[one.end() :]


def _word(data: bytes, rng: np.random.Generator) -> bytes:
    return _replaced(_WORD, data, rng)


def _bits(data: bytes, rng: np.random.Generator) -> bytes:
    if not data:
        return data
    changed = bytearray(data)
    for place in rng.integers(len(changed), size=int(rng.integers(1, 9))):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _lost(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = sorted(rng.integers(len(data) + 1, size=2).tolist())
    return data[:start] + data[end:]


def _inserted(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data) + 1))
    return data[:place] + _token(rng) + data[place:]


def _repeated(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data) + 1))
    return data[:place] + _token(rng) * int(rng.choice([10, 1000, 20_000])) + data[place:]


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    """Lose, double, swap or move lines."""
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return data
    first, second = rng.integers(len(lines), size=2).tolist()
    match int(rng.integers(4)):
        case 0:
            del lines[first]
        case 1:
            lines.insert(second, lines[first])
        case 2:
            lines[first], lines[second] = lines[second], lines[first]
        case _:
            lines[first : first + 5] = []
    return b"".join(lines)


MUTATIONS: tuple[Mutation, ...] = (
    *(_number, _number, _scaled, _word, _lines),
    *(_bits, _cut, _lost, _inserted, _repeated),
)
