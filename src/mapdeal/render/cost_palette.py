"""The colours of costs, in all pictures of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    CostScale,
)
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colours

COST_LEVELS = 200
"""Colours of graded costs, the first of a palette."""


@dataclass(frozen=True, eq=False)
class CostPalette:
    """Palette indices of the costs of a scale."""

    by_value: NDArray[np.uint8]
    colours: Colours
    highest_graded: int
    lethal_cost: int
    free: int = COST_LEVELS
    inscribed: int = COST_LEVELS + 1
    lethal: int = COST_LEVELS + 2
    unknown: int = COST_LEVELS + 3
    contour: int = COST_LEVELS + 4

    @classmethod
    def of(cls, scale: CostScale) -> CostPalette:
        """Return the palette of a scale of costs."""
        on_byte_scale = scale == "costmap2d"
        top = INSCRIBED_INFLATED_OBSTACLE - 1 if on_byte_scale else OCCUPIED - 1
        by_value = np.full(256, cls.lethal, dtype=np.uint8)
        by_value[0] = cls.free
        by_value[1 : top + 1] = (np.arange(top) * COST_LEVELS) // top
        if on_byte_scale:
            by_value[INSCRIBED_INFLATED_OBSTACLE] = cls.inscribed
        by_value[NO_INFORMATION] = cls.unknown  # -1 on the occupancy scale
        palette = np.vstack([
            colours.cost_scale(COST_LEVELS),
            [colours.RVIZ_FREE, colours.INSCRIBED, colours.LETHAL, colours.RVIZ_UNKNOWN,
             colours.CONTOUR],
        ])  # fmt: skip
        lethal_cost = LETHAL_OBSTACLE if on_byte_scale else OCCUPIED
        return cls(by_value, palette.astype(np.uint8), top, lethal_cost)
