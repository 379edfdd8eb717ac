import numpy as np
from numpy.typing import NDArray

def search(
    costmap: NDArray[np.uint8],
    table: NDArray[np.uint8],
    start: tuple[int, int],
    target: tuple[int, int],
    is_astar: bool,
    potential: NDArray[np.float32],
) -> None: ...
def trace(
    potential: NDArray[np.float32],
    start: tuple[int, int],
    goal: tuple[int, int],
    path: NDArray[np.float32],
) -> tuple[int, int]: ...
