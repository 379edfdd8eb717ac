from typing import Any

from numpy.typing import NDArray

class PoseMaker:
    def __init__(
        self,
        blocked: NDArray[Any],
        width: int,
        firsts: NDArray[Any],
        offsets: NDArray[Any],
        area: tuple[int, int, int, int, int, int],
    ) -> None: ...
    def make(
        self, first: int, end: int, opened: NDArray[Any], numbers: NDArray[Any] | None = None
    ) -> None: ...

def flood(
    maker: PoseMaker, left: NDArray[Any], reached: NDArray[Any], seeds: NDArray[Any], most: int
) -> int: ...
