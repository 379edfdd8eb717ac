"""Texts of numbers, many at a time: rows of them, each in one of several forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import in_parallel

_NOISE = 1e-12
_NULL = "null"
_ROWS_TOGETHER = 1 << 11


class Kind(IntEnum):
    """How the numbers of a column are written; those that are not finite are ``null``.

    EXACT as `repr` writes them. SINGLE in as few digits as tell a float32 from its neighbours if
    the number is one, in nine otherwise, and as 0 below 1e-12, which is what rounding leaves of
    it. WHOLE without a point.
    """

    EXACT = 0
    SINGLE = 1
    WHOLE = 2


class Form(NamedTuple):
    """How the text of a row is made."""

    texts: tuple[str, ...]
    columns: tuple[int, ...]


def row_texts(
    values: NDArray[np.float64],
    kinds: Sequence[Kind],
    forms: Sequence[Form],
    chosen: NDArray[np.uint8],
) -> str:
    r"""Return rows of numbers as text."""
    if engine_name() != "compiled":
        return _by_python(values, kinds, forms, chosen)
    from mapdeal.kernels import _numbers

    values = np.ascontiguousarray(values)
    codes = np.array(kinds, dtype=np.uint8)
    pieces = [
        [(text.encode("ascii"), k) for text, k in zip(one.texts, (*one.columns, -1), strict=True)]
        for one in forms
    ]
    made = [""] * (-(-len(values) // _ROWS_TOGETHER))

    def some(first: int, end: int) -> None:
        for part in range(first, end):
            rows = slice(part * _ROWS_TOGETHER, (part + 1) * _ROWS_TOGETHER)
            made[part] = _numbers.rows(values[rows], codes, chosen[rows], pieces, _spelt)

    in_parallel(some, len(made))
    return "".join(made)


def _spelt(value: float, kind: int) -> bytes:
    """Return the text of a number that the compiled code leaves to others."""
    return _TEXTS[Kind(kind)](np.array([value]))[0].encode()


def _by_python(
    values: NDArray[np.float64],
    kinds: Sequence[Kind],
    forms: Sequence[Form],
    chosen: NDArray[np.uint8],
) -> str:
    texts = [_TEXTS[kind](column) for kind, column in zip(kinds, values.T, strict=True)]
    joined = ["%s".join(text.replace("%", "%%") for text in form.texts) for form in forms]
    return "".join(
        joined[form] % tuple(texts[column][row] for column in forms[form].columns)
        for row, form in enumerate(chosen.tolist())
    )


def _exact(values: NDArray[np.float64]) -> list[str]:
    return [repr(value) if math.isfinite(value) else _NULL for value in values.tolist()]


def _single(values: NDArray[np.float64]) -> list[str]:
    values = np.where(np.abs(values) < _NOISE, 0.0, values)
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32)
    short = single.astype(str).tolist()
    pairs = zip(values.tolist(), short, (single == values).tolist(), strict=True)
    return [
        (text if is_single else f"{value:.9g}") if math.isfinite(value) else _NULL
        for value, text, is_single in pairs
    ]


def _whole(values: NDArray[np.float64]) -> list[str]:
    return [str(int(value)) if math.isfinite(value) else _NULL for value in values.tolist()]


_TEXTS: dict[Kind, Callable[[NDArray[np.float64]], list[str]]] = {
    Kind.EXACT: _exact,
    Kind.SINGLE: _single,
    Kind.WHOLE: _whole,
}
