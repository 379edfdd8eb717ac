"""A map on standard input or output: an npz, which one file holds whole.

Readers and writers need files: they seek, look at sizes, and compare states. So what comes in is
kept in a file in a private folder, and what goes out is written there, whole, before the first byte
of it is sent.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from mapdeal.errors import MalformedInputError, MapdealError
from mapdeal.files.budget import claim, memory_limit
from mapdeal.files.source import LONGEST_STREAM, access_to
from mapdeal.inputs.kinds import kind_of

STDIN, STDOUT = "standard input", "standard output"

_ZIP = b"PK\3\4"
_LOOKED_AT = 1 << 16
_HINT = "a map comes by a pipe as an npz: mapdeal convert MAP -o - makes one of any map"


def keep_npz(chunks: Iterable[bytes], folder: Path) -> Path:
    """Write what comes in on standard input to a file, and return its name."""
    path = folder / f"{STDIN}.npz"
    length = 0
    head = b""
    with access_to(path, "written"), path.open("wb") as file:
        for chunk in chunks:
            length += len(chunk)
            file.write(chunk)
            if len(head) < _LOOKED_AT:
                head += chunk[:_LOOKED_AT]
                if not head.startswith(_ZIP[: len(head)]) and len(head) >= _LOOKED_AT:
                    break
            _check_length(length)
    if not head:
        hint = "the command before it in the pipe has written nothing"
        raise MalformedInputError("is empty", source=STDIN, hint=hint)
    if not head.startswith(_ZIP):
        raise _no_npz(path)
    return path


def _check_length(length: int) -> None:
    if memory_limit()[0] is not None:
        claim(STDIN, length)
    elif length > LONGEST_STREAM:
        rule = f"must not be larger than {LONGEST_STREAM} bytes"
        raise MalformedInputError(rule, source=STDIN)


def _no_npz(path: Path) -> MalformedInputError:
    kind = None
    with suppress(MapdealError):
        kind = kind_of(path)
    what = "is not an npz" if kind is None else f"is {kind.what}, not an npz"
    return MalformedInputError(what, source=STDIN, hint=_HINT)
