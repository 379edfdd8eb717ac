from typing import Any

from numpy.typing import NDArray

longest_side: int
unlimited: int

class Transform:
    def __init__(self, marked: NDArray[Any], cells: NDArray[Any], limit: int) -> None: ...
    def place(
        self,
        whole_height: int,
        before: tuple[NDArray[Any], NDArray[Any]] | None,
        after: tuple[NDArray[Any], NDArray[Any]] | None,
    ) -> None: ...
    @property
    def bands(self) -> int: ...
    def to_squares(self, both_kinds: bool) -> None: ...
    def to_bytes(self, table: NDArray[Any]) -> None: ...
    def to_metres(
        self, scale: float, outside_shift: float, inside_shift: float, clip: float, gain: float
    ) -> None: ...
    def scan(self, first: int, end: int) -> None: ...
    def join(self) -> None: ...
    def solve(self, first: int, end: int) -> None: ...

def look_up(values: NDArray[Any], table: NDArray[Any], result: NDArray[Any]) -> None: ...
def count_bytes(values: NDArray[Any], counts: NDArray[Any]) -> None: ...
def raise_costs(costs: NDArray[Any], asked: NDArray[Any], least: int) -> None: ...
def levels(
    distance: NDArray[Any],
    obstacles: NDArray[Any],
    unknown: NDArray[Any],
    result: NDArray[Any],
    low: float,
    factor: float,
    last: float,
    first: int,
    below: int,
    faded_by: int,
) -> None: ...
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
def interpolate(
    values: NDArray[Any], places: NDArray[Any], between: NDArray[Any], slopes: NDArray[Any]
) -> None: ...
def costs_of_footprints(
    costs: NDArray[Any],
    resolution: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    corners: NDArray[Any],
    poses: NDArray[Any],
    filled: bool,
    results: NDArray[Any],
    inside: NDArray[Any],
) -> None: ...
def lzf_expand(data: bytes, expanded: NDArray[Any]) -> bool: ...
def cheapest_path(
    weights: NDArray[Any],
    start: tuple[int, int],
    goal: tuple[int, int],
    least: float,
    surcharges: NDArray[Any] | None = None,
) -> tuple[NDArray[Any], float, int]: ...
def flood(
    is_open: NDArray[Any],
    width: int,
    sources: NDArray[Any],
    starts: NDArray[Any],
    limit: int,
    lengths: NDArray[Any],
    origin: NDArray[Any],
) -> None: ...
def costs_to_go(
    classes: NDArray[Any],
    weights: NDArray[Any],
    sources: NDArray[Any],
    starts: NDArray[Any],
    lists_per_cost: float,
    list_count: int,
    costs: NDArray[Any],
) -> None: ...
def look_along_lines(
    values: NDArray[Any],
    is_open: NDArray[Any],
    starts: NDArray[Any],
    ends: NDArray[Any],
    counts: NDArray[Any],
    near: float,
    least: NDArray[Any],
    are_open: NDArray[Any],
) -> None: ...
def trace_rings(
    follows: NDArray[Any],
    partner: NDArray[Any],
    stack: NDArray[Any],
    places: NDArray[Any],
    order: NDArray[Any],
    ends: NDArray[Any],
) -> int: ...
def straighten(
    corners: NDArray[Any], chains: NDArray[Any], tolerances: NDArray[Any], is_kept: NDArray[Any]
) -> None: ...
