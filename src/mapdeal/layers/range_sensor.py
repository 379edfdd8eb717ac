"""Costmap layer ``range``, used for sonars, before its first reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE
from mapdeal.layers.layer import CostmapLayer, MasterGrid

_PRIOR = 0.5  # probability of an obstacle before the first reading


@dataclass(frozen=True, repr=False)
class RangeSensorLayer(CostmapLayer):
    """Settings of the range sensor layer of Nav2 and ROS 1, without readings.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    clear_threshold : float
        Probability of an obstacle below which a cell is free, 0..1.
    mark_threshold : float
        Probability above which a cell is lethal, 0..1.

    Notes
    -----
    Without readings every cell has probability 0.5, between the usual thresholds: no cost changes.

    References
    ----------
    ``updateCosts`` and ``to_cost`` of ``range_sensor_layer.cpp`` and its header in nav2_costmap_2d,
    and in the package range_sensor_layer of ROS 1.
    """

    name: str = "range_sensor_layer"
    clear_threshold: float = 0.2
    mark_threshold: float = 0.8
    key: ClassVar[str] = "range"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::RangeSensorLayer",)
    ros1_plugins: ClassVar[tuple[str, ...]] = ("range_sensor_layer::RangeSensorLayer",)
    about: ClassVar[str] = "without readings: no effect, unless 0.5 lies outside its thresholds"
    marks_obstacles: ClassVar[bool] = True
    needs: ClassVar[str] = "observations"
    nav2_parameters: ClassVar[Mapping[str, str]] = {
        "enabled": "bool", "phi": "double", "inflate_cone": "double",
        "no_readings_timeout": "double", "clear_on_max_reading": "bool",
        "topics": "string_array", "input_sensor_type": "string",
    }  # fmt: skip

    def _cost(self) -> int | None:
        """Return the cost that the layer writes to all cells, if it has an effect."""
        probabilities = (_PRIOR, self.clear_threshold, self.mark_threshold)
        prior, clear, mark = (int(share * LETHAL_OBSTACLE) for share in probabilities)
        return LETHAL_OBSTACLE if prior > mark else FREE_SPACE if prior < clear else None

    def why_idle(self, has_unknown: bool) -> str | None:
        cost = self._cost()
        has_effect = cost == LETHAL_OBSTACLE or (cost == FREE_SPACE and has_unknown)
        return None if has_effect else "no observations"

    def unknown_after(self, is_unknown: bool) -> bool:
        return is_unknown and self._cost() is None

    def apply(self, master: MasterGrid) -> None:
        cost = self._cost()
        if cost is not None:
            master.raise_to(np.full_like(master.costs, cost))

    def effect(self) -> str:
        if self._cost() == LETHAL_OBSTACLE:
            return "no observations: every cell becomes lethal, as mark_threshold is below 0.5"
        return "no observations: unknown cells become free, as clear_threshold is above 0.5"
