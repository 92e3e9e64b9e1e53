"""Compressed chunks of bags unpacked within bounds: a small file must not fill the memory.

rosbags unpacks a chunk whole, however large it becomes, and has no option for that: its tables of decompressors are
given others.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

#: No recorder makes larger chunks: they are some megabytes, or one message.
MOST_BYTES = 2**28


class _Decompressor(Protocol):
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...

    @property
    def eof(self) -> bool: ...


@cache
def bound_chunks() -> None:
    """Let rosbags raise ValueError over a chunk of more than `MOST_BYTES`, EOFError over half of one, from now on."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as rosbag1
    from rosbags.rosbag2 import storage_mcap as mcap

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    rosbag1.decompressors.update(bz2=_bounded(bz2.BZ2Decompressor), lz4=_bounded(LZ4FrameDecompressor))
    mcap.DECOMPRESSORS.update(zstd=_bounded(zstd.ZstdDecompressor), lz4=_bounded(LZ4FrameDecompressor))


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
