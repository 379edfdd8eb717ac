"""Bare arrays of two axes in ``.npy`` files, written in one pass."""

from __future__ import annotations

import io
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format

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
