from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

def rows(
    values: NDArray[np.float64],
    kinds: NDArray[np.uint8],
    chosen: NDArray[np.uint8],
    forms: list[list[tuple[bytes, int]]],
    spell: Callable[[float, int], bytes],
) -> str: ...
