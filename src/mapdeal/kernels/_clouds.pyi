import numpy as np
from numpy.typing import NDArray

def mark(
    points: NDArray[np.float64],
    numbers: tuple[float, ...],
    is_placed: bool,
    hit: NDArray[np.uint8],
    seen: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> int: ...
def cover(
    angles: NDArray[np.float64],
    turn: float,
    half: float,
    first: NDArray[np.float64],
    last: NDArray[np.float64],
) -> None: ...
def parse(text: bytes, with_slashes: bool, numbers: NDArray[np.float64]) -> int: ...
