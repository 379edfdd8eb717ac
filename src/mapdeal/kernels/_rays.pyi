from typing import Any

from numpy.typing import NDArray

def count(
    starts: NDArray[Any],
    ends: NDArray[Any],
    is_hit: NDArray[Any],
    hits: NDArray[Any],
    misses: NDArray[Any],
    bottom: int,
    top: int,
) -> None: ...
def weigh(
    starts: NDArray[Any],
    ends: NDArray[Any],
    is_hit: NDArray[Any],
    on_miss: int,
    on_hit: int,
    lowest: int,
    highest: int,
    values: NDArray[Any],
    seen: NDArray[Any],
    bottom: int,
    top: int,
) -> None: ...
def measure(
    starts: NDArray[Any],
    ends: NDArray[Any],
    sensors: NDArray[Any],
    ranges: NDArray[Any],
    truncation: float,
    behind: float,
    cell: float,
    sums: NDArray[Any],
    weights: NDArray[Any],
    bottom: int,
    top: int,
) -> None: ...
def cells(
    points: NDArray[Any],
    found: NDArray[Any],
    x: float,
    y: float,
    cosine: float,
    sine: float,
    resolution: float,
    rounding: float,
    tolerance: float,
    farthest: float,
) -> bool: ...
def cast(
    room: NDArray[Any],
    starts: NDArray[Any],
    directions: NDArray[Any],
    limit: float,
    distances: NDArray[Any],
) -> None: ...
