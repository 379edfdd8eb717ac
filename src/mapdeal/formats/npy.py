"""Bare arrays of two axes in ``.npy`` files, written in one go or by rows in any order."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError
from mapdeal.formats.deflate import pieces
from mapdeal.kernels.blocks import Layer


def write_npy(file: BinaryIO, array: Layer) -> None:
    """Write an array."""
    file.write(npy_header(array.shape, array.dtype))
    file.writelines(pieces(array))


def npy_header(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    """Return the bytes before the values of an array."""
    header = io.BytesIO()
    facts = {"descr": npy_format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy_format.write_array_header_1_0(header, facts)
    return header.getvalue()


def begin_npy(path: Path, shape: tuple[int, int], dtype: np.dtype[Any]) -> int:
    """Write what comes before the values, and make room for these; return where they begin."""
    header = npy_header(shape, dtype)
    try:
        with path.open("r+b") as file:
            file.write(header)
            file.truncate(len(header) + shape[0] * shape[1] * dtype.itemsize)
    except OSError as error:
        raise FileAccessError(f"cannot be written: {error.strerror}", source=path) from None
    return len(header)


def write_rows(path: Path, offset: int, rows: NDArray[Any]) -> None:
    """Write rows in their place, through to the disk: other processes may read them then."""
    try:
        with path.open("r+b") as file:
            file.seek(offset)
            file.write(np.ascontiguousarray(rows).data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise FileAccessError(f"cannot be written: {error.strerror}", source=path) from None
