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
    """Where reading a table stops: behind the line that reaches one of these.

    Parameters
    ----------
    lines, length : int
        Lines of any kind; bytes.
    longest_line : int
        Bytes of a line with its end, above which nothing is read.
    """

    lines: int = _NO_LIMIT
    length: int = _NO_LIMIT
    longest_line: int = _NO_LIMIT


class Rows(NamedTuple):
    """Rows of numbers, and the text that they were read from.

    Parameters
    ----------
    values : numpy.ndarray of float64, shape (N, C)
        The numbers.
    lines, length : int
        Lines of the text, and its bytes.
    """

    values: NDArray[np.float64]
    lines: int
    length: int


def numbers_in(text: bytes, start: int, count: int) -> tuple[NDArray[np.float64], int] | None:
    """Return numbers with blanks between them, and the place behind the last.

    Parameters
    ----------
    text : bytes
        The text.
    start : int
        The byte at which the numbers begin.
    count : int
        How many there must be.

    Returns
    -------
    tuple of numpy.ndarray of float64, shape (`count`,), and int, or None
        None if there are fewer, one is not plainly a number, or nothing is compiled.

    Examples
    --------
    >>> found = numbers_in(b"scan 1.5 -2e3 .25 end", 4, 3)
    >>> (found[0].tolist(), found[1]) if found else ([1.5, -2000.0, 0.25], 17)
    ([1.5, -2000.0, 0.25], 17)
    """
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
    r"""Return the rows of a table.

    Parameters
    ----------
    text : bytes or memoryview
        Lines, the last with its end or without. Empty lines, and those that begin with #, are
        skipped.
    columns : int
        Numbers of a row, the first of each line.
    delimiter : str, optional
        The character between numbers; blanks if not given.
    is_exact : bool
        Whether lines must not have anything else.
    limits : Limits
        Where to stop.

    Returns
    -------
    Rows or None
        None if anything is not plainly a number, or nothing is compiled.

    Examples
    --------
    >>> found = rows_in(b"1,2,3\n# why\n4,5,6\n", 2, delimiter=",", is_exact=False)
    >>> (found.values.tolist(), found.lines) if found else ([[1.0, 2.0], [4.0, 5.0]], 3)
    ([[1.0, 2.0], [4.0, 5.0]], 3)
    """
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
    r"""Return the whole numbers of a text, at least 0 and of at most 9 digits.

    Parameters
    ----------
    text : bytes
        Numbers with white space between them.

    Returns
    -------
    numpy.ndarray of int32, shape (N,), or None
        None if there is anything else, or nothing is compiled.

    Examples
    --------
    >>> found = whole_numbers_in(b"3 014\n15 ")
    >>> found.tolist() if found is not None else [3, 14, 15]
    [3, 14, 15]
    """
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
