"""Types of the arrays that kernels accept and return."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Basins = NDArray[np.int32]
Bytes = NDArray[np.uint8]
SignedBytes = NDArray[np.int8]
Integers32 = NDArray[np.int32]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Metres = NDArray[np.float32]
SquaredDistances = NDArray[np.signedinteger[Any]]

_LONGEST_SIDE_IN_32_BITS = 32767  # twice its square stays below the largest int32: unreachable


def unreachable(squared: SquaredDistances) -> int:
    """Return the value that stands for "no such cell" in an array of squared distances."""
    return int(np.iinfo(squared.dtype).max)


def dtype_of_squares(shape: tuple[int, ...]) -> type[np.int32] | type[np.int64]:
    return np.int32 if max(shape) <= _LONGEST_SIDE_IN_32_BITS else np.int64
