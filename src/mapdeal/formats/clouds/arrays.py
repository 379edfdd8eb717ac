"""Clouds in numpy's own files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, MapdealWarning
from mapdeal.formats.npz_reader import NpzReader

_POINTS_TOGETHER = 1 << 18
_MOST_ELEMENTS = 1 << 31
_MOST_LIKELY = 16
_KEY = "points"


def npz_points(path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of the array `points` of an npz file, or of the only array that it has."""
    with NpzReader(path, _MOST_ELEMENTS) as reader:
        names = reader.names()
        if _KEY not in names and len(names) != 1:
            rule = "must hold an array points, or one array alone"
            raise MalformedInputError(rule, source=path, got=", ".join(sorted(names)))
        yield from reader.rows(_KEY if _KEY in names else names.pop(), 3)


def npy_points(path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of an npy file, through a memory map."""
    from tokenize import TokenError  # of use to few, and slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers that Python 2 wrote
            table = np.lib.format.open_memmap(path, mode="r")
    # What reading a damaged header leads to, in numpy.
    except (ValueError, EOFError, SyntaxError, TokenError, LookupError, TypeError,
            OverflowError) as error:  # fmt: skip
        raise MalformedInputError(f"is not an npy file: {error}", source=path) from None
    columns = _columns_of(table, path)
    for first in range(0, len(table), _POINTS_TOGETHER):
        part = [column[first : first + _POINTS_TOGETHER] for column in columns]
        yield np.stack(part, axis=1).astype(np.float64)


def _columns_of(table: NDArray[Any], path: Path) -> list[NDArray[Any]]:
    """Return x, y and z of a table, or of records with fields of these names."""
    names = table.dtype.names
    if names is not None:
        columns = [table[name] for name in ("x", "y", "z") if name in names]
        if {"x", "y"} <= set(names) and all(_is_column(column) for column in columns):
            return columns
    elif table.dtype.kind in "iuf" and table.ndim == 2 and table.shape[1] >= 2:
        if table.shape[0] in (2, 3) and table.shape[1] > _MOST_LIKELY:
            text = f"{path}: {table.shape[0]} points of {table.shape[1]} numbers each;"
            warnings.warn(f"{text} is the array transposed?", MapdealWarning, stacklevel=2)
        return [table[:, k] for k in range(min(3, table.shape[1]))]
    rule = "must be numbers of shape (N, 2) or wider, or records with x and y"
    raise MalformedInputError(rule, source=path, got=f"{table.dtype} of shape {table.shape}")


def _is_column(array: NDArray[Any]) -> bool:
    return array.dtype.kind in "iuf" and array.ndim == 1
