"""Compressed chunks and messages of bags unpacked within bounds: a small file must not fill the memory.

rosbags unpacks them whole, however large they become, and has no option for that: its decompressors are replaced.
A bag compressed as a file it unpacks to disk, piece by piece.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, Protocol

#: No recorder makes larger chunks: they are some megabytes, or one message.
MOST_BYTES = 2**28


class _Decompressor(Protocol):
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...

    @property
    def eof(self) -> bool: ...


@cache
def bound_chunks() -> None:
    """Let rosbags raise ValueError over a chunk or message of more than `MOST_BYTES`, EOFError over half of one."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as rosbag1
    from rosbags.rosbag2 import reader as rosbag2
    from rosbags.rosbag2 import storage_mcap as mcap

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    rosbag1.decompressors.update(bz2=_bounded(bz2.BZ2Decompressor), lz4=_bounded(LZ4FrameDecompressor))
    bounded = _bounded(zstd.ZstdDecompressor)
    mcap.DECOMPRESSORS.update(zstd=bounded, lz4=_bounded(LZ4FrameDecompressor))
    # Of a bag compressed message by message; the reader knows the library by this name.
    vars(rosbag2)["zstd"] = SimpleNamespace(open=zstd.open, decompress=bounded)


def _bounded(make: Callable[[], _Decompressor]) -> Callable[..., bytes]:
    def unpacked(data: bytes, *_: Any) -> bytes:
        decompressor = make()
        content = decompressor.decompress(data, MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ValueError(f"a chunk of more than {MOST_BYTES // 2**20} MB")
        if not decompressor.eof:
            raise EOFError("half a chunk")
        return content

    return unpacked
