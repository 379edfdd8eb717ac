"""Values of cells, and the scales of costs.

Scales have 256 entries and are indexed by a value's byte, so that occupancy -1 is the last entry,
as `mapdeal.kernels.lookup.look_up` expects. Their names read ``TO_from_FROM``.

References
----------
``nav_msgs/OccupancyGrid`` for the occupancy values; ``costmap_2d/cost_values.h`` for the costs.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import require

UNKNOWN: Final = -1
FREE: Final = 0
OCCUPIED: Final = 100

FREE_SPACE: Final = 0
INSCRIBED_INFLATED_OBSTACLE: Final = 253
LETHAL_OBSTACLE: Final = 254
NO_INFORMATION: Final = 255
INSCRIBED_PUBLISHED: Final = 99  # of inscribed, as occupancy; planners enter cells below it
DEFAULT_LETHAL_THRESHOLD: Final = 100
CostScale = Literal["costmap2d", "occupancy"]
UnknownPolicy = Literal["free", "occupied"]
OverlayType = Literal["seq", "max", "min"]
Convention = Literal["fast-planner", "center", "border"]
Drawer = Callable[[object], bytes | None]  # from an object to its PNG, if it has a picture
MOST_COUNTED = 100_000_000  # cells whose values a repr counts, in tenths of a second
_MOST_LISTED = 6
_drawers: list[Drawer] = []


def check_choice(value: object, choices: Any, name: str) -> None:
    known = get_args(choices)
    require(value in known, f"must be one of {', '.join(known)}", name, got=value)


def occupancy_from_cost() -> NDArray[np.int8]:
    # From ``costmap_2d_publisher.cpp`` of both ROS navigation stacks: 1 + 97 (cost - 1) / 251 in
    # integer division. Not invertible.
    table = 1 + (97 * (np.arange(256) - 1)) // 251
    table[FREE_SPACE] = FREE
    table[INSCRIBED_INFLATED_OBSTACLE] = 99
    table[LETHAL_OBSTACLE] = OCCUPIED
    table[NO_INFORMATION] = UNKNOWN
    return table.astype(np.int8)


def cost_from_occupancy() -> NDArray[np.uint8]:
    table = np.full(256, NO_INFORMATION, dtype=np.uint8)
    table[: OCCUPIED + 1] = (LETHAL_OBSTACLE * np.arange(OCCUPIED + 1) + OCCUPIED // 2) // OCCUPIED
    return table


def static_layer_cost_from_occupancy(
    *, lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD, trinary: bool = True,
    track_unknown: bool = True, inscribed_value: int | None = 99,
    unknown_value: int = NO_INFORMATION,
) -> NDArray[np.uint8]:  # fmt: skip
    # As ``interpretValue`` in ``static_layer.cpp``, which first casts the value to unsigned char.
    values, rule = range(OCCUPIED + 1), "must be a whole number from 0 to 100"
    require(lethal_threshold in values, rule, "lethal_threshold", got=lethal_threshold)
    is_value = inscribed_value is None or inscribed_value in values
    require(is_value, f"{rule}, or none", "inscribed_value", got=inscribed_value)
    table = np.full(256, LETHAL_OBSTACLE, dtype=np.uint8)
    shares = np.arange(lethal_threshold) * LETHAL_OBSTACLE // max(lethal_threshold, 1)
    table[:lethal_threshold] = FREE_SPACE if trinary else shares
    if inscribed_value is not None:
        table[inscribed_value] = INSCRIBED_INFLATED_OBSTACLE
    table[unknown_value] = NO_INFORMATION if track_unknown else FREE_SPACE
    return table


def draw_with(drawer: Drawer) -> None:
    """Set the function that draws pictures for notebooks; grids cannot draw themselves."""
    _drawers[:] = [drawer]


class OneLineRepr:
    __slots__ = ()

    @abstractmethod
    def _repr_parts(self) -> Iterator[str]: ...

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._repr_parts())})"


class Drawn(OneLineRepr):
    """Base class of objects that notebooks also show as a picture."""

    __slots__ = ()

    def _repr_png_(self) -> bytes | None:
        return _drawers[0](self) if _drawers else None


def numbers_text(numbers: Iterable[float]) -> str:
    return f"({', '.join(f'{number + 0.0:.10g}' for number in numbers)})"


def place_text(place: Iterable[float]) -> str:
    return ", ".join(f"{coordinate + 0.0:.6g}" for coordinate in place)


def points_text(points: Sequence[Sequence[float]]) -> str:
    if len(points) > _MOST_LISTED:
        return f"{len(points)} points from {numbers_text(points[0])}"
    return f"[{', '.join(map(numbers_text, points))}]"


def table_lines(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(map(str.ljust, row, widths)).rstrip()


def join_words(words: Iterable[str], conjunction: str = "or") -> str:
    *first, last = words
    return f" {conjunction} ".join(filter(None, [", ".join(first), last]))


def count_text(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def few_text(names: Sequence[str], most: int) -> str:
    remaining = len(names) - most
    return ", ".join(names[:most]) + (f" and {remaining} more" if remaining > 0 else "")


def decimal_text(number: float, digits: int = 4) -> str:
    """Return a number with a few digits and without an exponent, such as 275,800 or 0.00125."""
    from decimal import Decimal  # slow to import

    return f"{Decimal(f'{number:.{digits}g}'):,f}" if math.isfinite(number) else f"{number}"
