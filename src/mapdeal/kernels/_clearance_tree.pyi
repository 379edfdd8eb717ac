from typing import Any

from numpy.typing import NDArray

most_cells: int

class Basins:
    bands: int
    def __init__(
        self, squared: NDArray[Any], traversable: NDArray[Any], basins: NDArray[Any]
    ) -> None: ...
    def point(self, first: int, end: int) -> None: ...
    def counts(self) -> tuple[int, int]: ...
    def number(self, peaks: NDArray[Any], peak_cells: NDArray[Any]) -> None: ...
    def join(self) -> None: ...
    def label(self, first: int, end: int) -> None: ...
    def take_edges(self, keys: NDArray[Any]) -> None: ...

def sort_edges(keys: NDArray[Any], spare: NDArray[Any]) -> bool: ...
def span_basins(
    basins: NDArray[Any],
    keys: NDArray[Any],
    sets: NDArray[Any],
    one: NDArray[Any],
    other: NDArray[Any],
    squares: NDArray[Any],
    cells: NDArray[Any],
) -> int: ...
def root_tree(
    one: NDArray[Any],
    other: NDArray[Any],
    squares: NDArray[Any],
    begins: NDArray[Any],
    ends: NDArray[Any],
    order: NDArray[Any],
    parent_edges: NDArray[Any],
    bottlenecks: NDArray[Any],
) -> int: ...
def paint(
    squared: NDArray[Any],
    basins: NDArray[Any] | None,
    limits: NDArray[Any] | None,
    resolution: float,
    painted: NDArray[Any],
) -> None: ...
def limit(
    squared: NDArray[Any], basins: NDArray[Any], limits: NDArray[Any], widest: NDArray[Any]
) -> None: ...
def count_above(
    squared: NDArray[Any], basins: NDArray[Any], above: int, counts: NDArray[Any]
) -> None: ...
