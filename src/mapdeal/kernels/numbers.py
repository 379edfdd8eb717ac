"""Numbers in text, read as Python's ``float`` reads them, to the last bit.

The compiled reader takes what is plainly made of numbers, and refuses all else: the caller then
reads it in another way, which also reports what is wrong.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

_NO_LIMIT = (1 << 63) - 1


class Limits(NamedTuple):
    """Where reading a table stops: behind the line that reaches one of these."""

    lines: int = _NO_LIMIT
    length: int = _NO_LIMIT
    longest_line: int = _NO_LIMIT


class Rows(NamedTuple):
    """Rows of numbers, and the text that they were read from."""

    values: NDArray[np.float64]
    lines: int
    length: int


def numbers_in(text: bytes, start: int, count: int) -> tuple[NDArray[np.float64], int] | None:
    """Return numbers with blanks between them, and the place behind the last."""
    compiled = compiled_numbers()
    if compiled is None or count > len(text):
        return None
    values = np.empty(count)
    stopped = compiled.row(text, start, values)
    return None if stopped < 0 else (values, stopped)


def rows_in(
    text: bytes | memoryview,
    columns: int,
    *,
    delimiter: str | None,
    is_exact: bool,
    limits: Limits = Limits(),  # noqa: B008 - it is immutable
) -> Rows | None:
    r"""Return the rows of a table."""
    compiled = compiled_numbers()
    if compiled is None or columns < 1:
        return None
    # a number takes two bytes at least, with what is behind it; one row more, so that whatever is
    # left behind the last is looked at
    rows = min(limits.lines, len(text) // (2 * columns) + 1)
    values = np.empty((rows, columns))
    mark = 0 if delimiter is None else ord(delimiter)
    found = compiled.table(
        text, mark, is_exact, limits.longest_line, limits.lines, limits.length, values
    )
    return None if found is None else Rows(values[: found[0]], found[1], found[2])


def whole_numbers_in(text: bytes) -> NDArray[np.int32] | None:
    r"""Return the whole numbers of a text, at least 0 and of at most 9 digits."""
    compiled = compiled_numbers()
    if compiled is None:
        return None
    values = np.empty((len(text) + 1) // 2, dtype=np.int32)
    count = compiled.whole(text, values)
    return None if count < 0 else values[:count]


def compiled_numbers() -> ModuleType | None:
    """Return what is compiled for numbers and text, or None if that is not to be used.

    It is loaded by those alone that read or write text; without it they do so in Python.
    """
    return _loaded() if engine_name() == "compiled" else None


@cache
def _loaded() -> ModuleType | None:
    try:
        from mapdeal.kernels import _numbers
    except ImportError:
        return None
    return _numbers
