"""Bare arrays in ``.npy`` files: headers are read, arrays are written in one pass."""

from __future__ import annotations

import io
import math
import warnings
from typing import IO, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy_format

from mapdeal.formats.pillow_images import one_at_a_time
from mapdeal.formats.png import pieces
from mapdeal.kernels.blocks import Layer

_LONGEST_HEADER = 1 << 16
_READERS = {
    (1, 0): npy_format.read_array_header_1_0,
    (2, 0): npy_format.read_array_header_2_0,
    # which differs from 2 in letters of names alone: x, y and z are the same in both
    (3, 0): npy_format.read_array_header_2_0,
}


class NpyHeader(NamedTuple):
    """What an array is, and where in its file the values begin."""

    shape: tuple[int, ...]
    is_fortran: bool
    dtype: np.dtype[Any]
    start: int

    @property
    def elements(self) -> int:
        return math.prod(map(int, self.shape))

    @property
    def nbytes(self) -> int:
        return self.elements * self.dtype.itemsize


def read_npy_header(file: IO[bytes]) -> NpyHeader:
    """Read the header of an array from the start of a file; ValueError if it is damaged."""
    from tokenize import TokenError  # of use to few, and slow to import

    try:
        head = io.BytesIO(file.read(_LONGEST_HEADER))  # numpy would read any length
        version = npy_format.read_magic(head)
        if version not in _READERS:
            raise ValueError(f"version {version} is not supported")
        with one_at_a_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers that Python 2 wrote
            header = _READERS[version](head)
    # What a damaged header leads to, in numpy and in Python's parser; some texts have more lines.
    except (ValueError, EOFError, SyntaxError, TokenError, LookupError, TypeError,
            OverflowError, RecursionError, MemoryError) as error:  # fmt: skip
        raise ValueError(str(error).partition("\n")[0]) from None
    file.seek(head.tell())
    return NpyHeader(*header, head.tell())


def write_npy(file: BinaryIO, array: Layer) -> None:
    file.write(npy_header(array.shape, array.dtype))
    file.writelines(pieces(array))


def npy_header(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    """Return the bytes before the values of an array."""
    header = io.BytesIO()
    facts = {"descr": npy_format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy_format.write_array_header_1_0(header, facts)
    return header.getvalue()
