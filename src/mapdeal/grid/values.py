"""Values of cells, and the scales of costs.

Scales have 256 entries and are indexed by a value's byte, so that occupancy -1 is the last entry,
as `mapdeal.kernels.lookup.look_up` expects. Their names read ``TO_from_FROM``.

References
----------
``nav_msgs/OccupancyGrid`` for the occupancy values; ``costmap_2d/cost_values.h`` for the costs.
"""

from __future__ import annotations

from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError

UNKNOWN: Final = -1
FREE: Final = 0
OCCUPIED: Final = 100

FREE_SPACE: Final = 0
INSCRIBED_INFLATED_OBSTACLE: Final = 253
LETHAL_OBSTACLE: Final = 254
NO_INFORMATION: Final = 255

INSCRIBED_PUBLISHED: Final = 99
"""What ROS publishes for inscribed, on the occupancy scale: planners enter no cell from here on."""

DEFAULT_LETHAL_THRESHOLD: Final = 100

CostScale = Literal["costmap2d", "occupancy"]
UnknownPolicy = Literal["free", "occupied"]
OverlayType = Literal["seq", "max", "min"]
Convention = Literal["fast-planner", "center", "border"]


def check_choice(value: object, choices: Any, name: str) -> None:
    """Refuse a word that is none of the choices, a ``Literal``; the error calls it `name`."""
    known = get_args(choices)
    if value not in known:
        raise ParameterError(f"must be one of {', '.join(known)}", place=name, got=value)


def occupancy_from_cost() -> NDArray[np.int8]:
    """Return the value that costmap_2d publishes for each of the 256 costs."""
    # From ``costmap_2d_publisher.cpp`` of both ROS navigation stacks: 1 + 97 (cost - 1) / 251 in
    # integer division. Not invertible.
    table = 1 + (97 * (np.arange(256) - 1)) // 251
    table[FREE_SPACE] = FREE
    table[INSCRIBED_INFLATED_OBSTACLE] = 99
    table[LETHAL_OBSTACLE] = OCCUPIED
    table[NO_INFORMATION] = UNKNOWN
    return table.astype(np.int8)


def cost_from_occupancy() -> NDArray[np.uint8]:
    """Return the cost that Nav2's ``Costmap2D(OccupancyGrid)`` assigns to each value."""
    table = np.full(256, NO_INFORMATION, dtype=np.uint8)
    values = np.arange(OCCUPIED + 1)
    table[: OCCUPIED + 1] = (LETHAL_OBSTACLE * values + OCCUPIED // 2) // OCCUPIED
    return table


def static_layer_cost_from_occupancy(
    *,
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    trinary: bool = True,
    track_unknown: bool = True,
    inscribed_value: int | None = 99,
    unknown_value: int = NO_INFORMATION,
) -> NDArray[np.uint8]:
    """Return the cost that costmap_2d's static layer assigns to each value."""
    # From ``interpretValue`` in ``static_layer.cpp``, which casts the value to unsigned char first.
    if not 0 <= lethal_threshold <= OCCUPIED or lethal_threshold % 1:
        rule = "must be a whole number from 0 to 100"
        raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
    if inscribed_value is not None and (
        not 0 <= inscribed_value <= OCCUPIED or inscribed_value % 1
    ):
        rule = "must be a whole number from 0 to 100, or none"
        raise ParameterError(rule, place="inscribed_value", got=inscribed_value)
    table = np.full(256, LETHAL_OBSTACLE, dtype=np.uint8)
    below = np.arange(lethal_threshold)
    shares = below * LETHAL_OBSTACLE // max(lethal_threshold, 1)
    table[:lethal_threshold] = FREE_SPACE if trinary else shares
    if inscribed_value is not None:
        table[inscribed_value] = INSCRIBED_INFLATED_OBSTACLE
    table[unknown_value] = NO_INFORMATION if track_unknown else FREE_SPACE
    return table


def amcl_from_occupancy() -> NDArray[np.int8]:
    """Return the state that amcl assigns to each value: 0 -> -1 free, 100 -> +1 occupied, else 0.

    Examples
    --------
    >>> amcl_from_occupancy()[[0, 1, 99, 100, -1]].tolist()
    [-1, 0, 0, 1, 0]
    """
    table = np.zeros(256, dtype=np.int8)
    table[FREE] = -1
    table[OCCUPIED] = 1
    return table
