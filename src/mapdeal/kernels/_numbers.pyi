import numpy as np
from numpy.typing import NDArray

def row(text: bytes, start: int, values: NDArray[np.float64]) -> int: ...
def table(
    text: bytes, delimiter: int, is_exact: bool, values: NDArray[np.float64]
) -> tuple[int, int, int] | None: ...
