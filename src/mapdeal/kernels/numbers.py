"""Numbers in text, read as Python's ``float`` reads them, to the last bit.

The compiled reader takes what is plainly a table of numbers, and refuses all else: whoever asks then
reads it in another way, which also says what is wrong.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name


def numbers_in(text: bytes, start: int, count: int) -> tuple[NDArray[np.float64], int] | None:
    """Return numbers with blanks between them, and the place behind the last.

    Parameters
    ----------
    text : bytes
        Where they stand.
    start : int
        The byte from which on they do.
    count : int
        How many there are to be.

    Returns
    -------
    tuple of numpy.ndarray and int, or None
        None where there are not so many, one is not plainly a number, or nothing is compiled.

    Examples
    --------
    >>> found = numbers_in(b"scan 1.5 -2e3 .25 end", 4, 3)
    >>> (found[0].tolist(), found[1]) if found else ([1.5, -2000.0, 0.25], 17)
    ([1.5, -2000.0, 0.25], 17)
    """
    compiled = _compiled()
    if compiled is None:
        return None
    values = np.empty(count)
    stopped = compiled.row(text, start, values)
    return None if stopped < 0 else (values, stopped)


def rows_in(
    text: bytes, columns: int, *, delimiter: str | None, is_exact: bool, most: int | None = None
) -> tuple[NDArray[np.float64], int, int] | None:
    """Return the rows of a table, and how many bytes and lines they are.

    Parameters
    ----------
    text : bytes
        Whole lines; empty ones, and those that begin with #, are skipped.
    columns : int
        Numbers of each row: the first of a line.
    delimiter : str, optional
        What is between numbers; blanks if not given.
    is_exact : bool
        Whether lines have no more than these.
    most : int, optional
        Rows after which to stop.

    Returns
    -------
    tuple of numpy.ndarray, int and int, or None
        None where anything is not plainly a number, or nothing is compiled.
    """
    compiled = _compiled()
    if compiled is None:
        return None
    rows = text.count(b"\n") if most is None else min(most, text.count(b"\n"))
    values = np.empty((rows, columns))
    found = compiled.table(text, 0 if delimiter is None else ord(delimiter), is_exact, values)
    return None if found is None else (values[: found[0]], found[1], found[2])


def _compiled() -> ModuleType | None:
    if engine_name() != "compiled":
        return None
    from mapdeal.kernels import _numbers

    return _numbers
