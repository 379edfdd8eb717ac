from typing import Any

from numpy.typing import NDArray

longest_side: int
unlimited: int

class Transform:
    def __init__(self, marked: NDArray[Any], cells: NDArray[Any], limit: int) -> None: ...
    @property
    def bands(self) -> int: ...
    def to_squares(self, both_kinds: bool) -> None: ...
    def to_bytes(self, table: NDArray[Any]) -> None: ...
    def to_metres(
        self,
        scale: float,
        outside_shift: float,
        inside_shift: float,
        clip: float,
        gain: float,
    ) -> None: ...
    def scan(self, first: int, end: int) -> None: ...
    def join(self) -> None: ...
    def solve(self, first: int, end: int) -> None: ...

def look_up(values: NDArray[Any], table: NDArray[Any], result: NDArray[Any]) -> None: ...
def count_bytes(values: NDArray[Any], counts: NDArray[Any]) -> None: ...
def bytes_of_distances(
    distance: NDArray[Any],
    obstacles: NDArray[Any],
    table: NDArray[Any],
    result: NDArray[Any],
    scale: float,
    shift: float,
    gain: float,
    clip: float,
) -> None: ...
