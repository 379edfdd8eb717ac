"""Texts of numbers, many at a time: rows of them, each in one of several forms."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_NOISE = 1e-12


class Kind(Enum):
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
    values: NDArray[np.float64], kinds: Sequence[Kind], forms: Sequence[Form],
    chosen: NDArray[np.uint8],
) -> str:  # fmt: skip
    """Return rows of numbers as text, each in the form that is chosen for it."""
    rows = np.empty(len(values), dtype=object)
    for number, form in enumerate(forms):
        own = chosen == number
        texts = [_texts(values[own, column], kinds[column]) for column in form.columns]
        template = "%s".join(text.replace("%", "%%") for text in form.texts)
        rows[own] = [template % row for row in zip(*texts, strict=True)]
    return "".join(rows)


def _texts(values: NDArray[np.float64], kind: Kind) -> list[str]:
    if kind is Kind.SINGLE:
        values = np.where(np.abs(values) < _NOISE, 0.0, values)
        with np.errstate(over="ignore", invalid="ignore"):
            single = values.astype(np.float32)
        texts = list(map("%.9g".__mod__, values.tolist()))
        short = np.flatnonzero(single == values)
        for index, text in zip(short.tolist(), single[short].astype(str).tolist(), strict=True):
            texts[index] = text
    elif kind is Kind.WHOLE:
        texts = [f"{value:.0f}" for value in values.tolist()]
    else:
        texts = list(map(repr, values.tolist()))
    for index in np.flatnonzero(~np.isfinite(values)).tolist():
        texts[index] = "null"
    return texts
