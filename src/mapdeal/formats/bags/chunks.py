"""Chunks of bags: how they are compressed, and the last few of them kept expanded."""

from __future__ import annotations

import bz2
import sys
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError
from mapdeal.formats.budget import check_expansion, claim, most_expanded

_KEPT_BYTES = 1 << 25
_KEPT = 8


def expanded(
    data: bytes, compression: str, size: int | None, path: Path, *, partly: bool = False
) -> bytes:
    """Return what data of a bag expand to."""
    if compression in ("", "none"):
        return data
    if compression not in _EXPANDERS:
        rule = "chunks can be compressed with bz2, lz4 or zstd"
        raise MalformedInputError(rule, source=path, got=compression)
    if size is not None:
        check_expansion(path, len(data), size)
        claim(path, len(data) + 2 * size, what=f"the {size} bytes of a chunk")
    most = most_expanded(len(data)) if size is None else size
    try:
        # one byte more than it claims, so that a lie shows, and a bomb stays small
        found = _EXPANDERS[compression](data, most + 1)
    except MemoryError:  # what it expands to has been claimed: the chunk is not to blame
        raise
    except Exception as error:  # noqa: BLE001 - each library has errors of its own
        if partly:
            return b""
        rule = f"a chunk is damaged: {error}"
        raise MalformedInputError(rule, source=path) from None
    if size is None and len(found) > most:
        rule = f"{len(data)} bytes of a message would expand to more than {most}"
        hint = "--max-memory SIZE allows more, if that much is available"
        raise MalformedInputError(rule, source=path, hint=hint)
    if size is not None and len(found) != size and not (partly and len(found) < size):
        rule = f"a chunk must expand to {size} bytes, and does not"
        raise MalformedInputError(rule, source=path)
    return found


def zstd_module() -> Any:
    """Return what reads zstd: Python's own module, or that of rosbags' dependencies before 3.14."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def _with_bz2(data: bytes, most: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, most)


def _with_lz4(data: bytes, most: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return bytes(LZ4FrameDecompressor().decompress(data, most))


def _with_zstd(data: bytes, most: int) -> bytes:
    return bytes(zstd_module().ZstdDecompressor().decompress(data, most))


_EXPANDERS: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": _with_bz2,
    "lz4": _with_lz4,
    "zstd": _with_zstd,
}


class KeptChunks:
    """The last few chunks: messages in order of time alternate between two or three."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._bytes = 0

    def __getitem__(self, number: int) -> bytes:
        """Return a chunk."""
        found = self._kept.get(number)
        if found is not None:
            self._kept.move_to_end(number)
            return found
        while len(self._kept) >= _KEPT or self._bytes > _KEPT_BYTES:
            _, old = self._kept.popitem(last=False)
            self._bytes -= len(old)
            del old  # before another is read
        chunk = self._read(number)
        self._kept[number] = chunk
        self._bytes += len(chunk)
        return chunk
