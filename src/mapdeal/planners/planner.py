"""The base class of planners, the costmap that they search, and the plan that they return.

A new planner is one module of this package with a subclass of `Planner`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, ClassVar, Literal

import numpy as np

from mapdeal import planners, records
from mapdeal.kernels.arrays import Bytes, Floats

# of a parameter, and its type: ROS 2 refuses values of another one
Default = bool | int | float | str | tuple[str, ...]
Pose = tuple[float, float, float]  # x and y, metres, and yaw, radians, in the map's frame
Reason = Literal[  # the exceptions with which Nav2's planners fail
    "StartOccupied", "GoalOccupied", "StartOutsideMapBounds", "GoalOutsideMapBounds",
    "NoValidPathCouldBeFound", "PlannerTimedOut", "PlannerException",
]  # fmt: skip


@records.dataclass(frozen=True, eq=False)
class PlannerGrid:
    """A costmap as Nav2's planners see it. The yaw of its origin is ignored, as there."""

    costs: Bytes  # Nav2's: 253 inscribed, 254 lethal, 255 unknown
    resolution: float  # metres, rounded to float32 as in the map's message
    origin: tuple[float, float]  # metres
    footprint: Floats | None = None  # padded outline, metres; None for round robots

    def cell_of(self, pose: Pose) -> tuple[int, int] | None:
        """Return row and column as ``worldToMap`` does; None outside of the costmap."""
        rows, columns = self.costs.shape
        column, row = map(math.floor, self.place_of(pose))
        return (row, column) if 0 <= row < rows and 0 <= column < columns else None

    def place_of(self, point: Sequence[float]) -> tuple[float, float]:
        """Return x and y in cells."""
        west, south = self.origin
        return (point[0] - west) / self.resolution, (point[1] - south) / self.resolution


@records.dataclass(frozen=True, eq=False)
class Plan:
    found: bool
    reason: Reason | None = None  # name of Nav2's exception if there is no plan
    poses: Floats = records.field(default_factory=lambda: np.empty((0, 3)))  # x, y, yaw
    cost: float | None = None  # of the path before it was smoothed, where a planner computes it
    detail: str | None = None  # why the planner failed, where the name leaves that open
    is_reached: bool = False  # by the search, though no plan came of it

    @property
    def is_known(self) -> bool:
        """Whether the planner is modelled, or no planner could find a path."""
        return self.found or self.reason is not None

    @property
    def length(self) -> float:
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


def no_plan(reason: Reason, detail: str | None = None) -> Plan:
    return Plan(found=False, reason=reason, detail=detail)


def poses_of(points: Floats, yaw: float | None) -> Floats:
    """Return poses of points whose last one has a yaw, that of the last step if it is None."""
    poses = np.zeros((len(points), 3))
    poses[:, : points.shape[1]] = points
    dx, dy = points[-1, :2] - points[-2, :2]
    poses[-1, 2] = math.atan2(dy, dx) if yaw is None else yaw
    return poses


class Planner(ABC):
    """A planner with the values of its parameters; those that are not set have their defaults."""

    plugin_names: ClassVar[tuple[str, ...]] = ()  # in parameter files, with :: and with /
    parameters: ClassVar[Mapping[str, Default]] = {}  # all that Nav2 declares below its name
    moves_diagonally: ClassVar[bool] = True  # to all eight neighbours, not just to four

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self.values: dict[str, Any] = {**self.parameters, **(values or {})}

    def with_value(self, name: str, value: Default) -> Planner:
        return type(self)({**self.values, name: value})

    @abstractmethod
    def plan(self, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
        """Return the plan between two poses on an untouched costmap."""


@cache
def planner_classes() -> dict[str, type[Planner]]:
    for module in iter_modules(planners.__path__):
        import_module(f"{planners.__name__}.{module.name}")
    return {name: planner for planner in Planner.__subclasses__() for name in planner.plugin_names}
