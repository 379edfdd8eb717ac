"""The values that cells take, by the names that ROS gives them.

References
----------
``nav_msgs/OccupancyGrid`` for the occupancy values; ``costmap_2d/cost_values.h`` for the costs.
"""

from __future__ import annotations

from typing import Any, Final, Literal, get_args

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
