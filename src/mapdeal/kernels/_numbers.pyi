from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

def row(text: bytes, start: int, values: NDArray[np.float64]) -> int: ...
def table(
    text: bytes | memoryview,
    delimiter: int,
    is_exact: bool,
    longest_line: int,
    most_lines: int,
    most_bytes: int,
    values: NDArray[np.float64],
) -> tuple[int, int, int] | None: ...
def whole(text: bytes, values: NDArray[np.int32]) -> int: ...
def rows(
    values: NDArray[np.float64],
    kinds: NDArray[np.uint8],
    chosen: NDArray[np.uint8],
    forms: list[list[tuple[bytes, int]]],
    spell: Callable[[float, int], bytes],
) -> str: ...
