from typing import Any

from numpy.typing import NDArray

def clear(
    starts: NDArray[Any],
    deltas: NDArray[Any],
    steps: NDArray[Any],
    costs: NDArray[Any],
    columns: NDArray[Any],
    mark_threshold: int,
    unknown_threshold: int,
) -> None: ...
def spread(
    seeds: NDArray[Any], squares: NDArray[Any], queue: NDArray[Any], ends: NDArray[Any], most: int
) -> None: ...
