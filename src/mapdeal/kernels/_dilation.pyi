import numpy as np
from numpy.typing import NDArray

most_reach: int

def cover(
    marked: NDArray[np.uint8],
    half_widths: NDArray[np.uint8],
    is_square: bool,
    covered: NDArray[np.uint8],
    bottom: int,
    top: int,
) -> None: ...
def put(
    values: NDArray[np.int8],
    threshold: int,
    half_widths: NDArray[np.uint8],
    is_square: bool,
    value: int,
    kept: int,
    found: NDArray[np.int8],
    bottom: int,
    top: int,
) -> None: ...
def ring(
    marked: NDArray[np.uint8],
    half_widths: NDArray[np.uint8],
    costs: NDArray[np.int8],
    values: NDArray[np.int8],
    ringed: NDArray[np.int8],
    bottom: int,
    top: int,
) -> None: ...
