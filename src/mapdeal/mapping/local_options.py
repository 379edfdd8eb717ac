"""How local maps are made of clouds."""

from __future__ import annotations

import math
from typing import Literal, get_args

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import check_point, check_resolution
from mapdeal.records import dataclass

CloudFrame = Literal["robot", "map"]
Unknown = Literal["keep", "free"]


@dataclass(frozen=True)
class LocalOptions:
    """How a local map is made of a cloud.

    Parameters
    ----------
    frame : {'robot', 'map'}
        What the cloud's coordinates are: ahead and to the left of the robot, or those of the
        map already.
    offset : tuple of float
        x and y that are taken off the points' coordinates in the map frame, metres.
    size : tuple of float
        Extent of the map along x and y, metres; covered by whole cells.
    resolution : float
        Side of a cell, metres.
    min_height, max_height : float, optional
        Least and greatest z of the points that count, metres, in the cloud's own coordinates.
    min_range, max_range : float, optional
        Least and greatest distance from the robot, in the plane, of the points that count.
    raytrace_range : float, optional
        How far from the robot beams have seen that cells are free, metres; as far as
        `max_range` if not given.
    unknown : {'keep', 'free'}
        Whether cells that nothing has seen stay unknown or are free. In a map of one cloud and
        no global map they are free in any case.

    Raises
    ------
    ParameterError
        If a number is not finite or of the wrong sign, or a limit below its counterpart.
    """

    frame: CloudFrame = "robot"
    offset: tuple[float, float] = (0.0, 0.0)
    size: tuple[float, float] = (20.0, 20.0)
    resolution: float = 0.05
    min_height: float | None = None
    max_height: float | None = None
    min_range: float | None = None
    max_range: float | None = None
    raytrace_range: float | None = None
    unknown: Unknown = "keep"

    def __post_init__(self) -> None:
        for name, known in (("frame", CloudFrame), ("unknown", Unknown)):
            if getattr(self, name) not in get_args(known):
                rule = f"must be one of {', '.join(get_args(known))}"
                raise ParameterError(rule, place=name, got=getattr(self, name))
        object.__setattr__(self, "offset", check_point(self.offset, "offset"))
        object.__setattr__(self, "size", check_point(self.size, "size"))
        object.__setattr__(self, "resolution", check_resolution(self.resolution))
        for name in ("min_height", "max_height"):
            self._check_limit(name, signed=True)
        for name in ("min_range", "max_range", "raytrace_range"):
            self._check_limit(name, signed=False)
        for what in ("height", "range"):
            self._check_order(f"min_{what}", f"max_{what}")

    def _check_limit(self, name: str, *, signed: bool) -> None:
        value = getattr(self, name)
        if value is None:
            return
        if not math.isfinite(value) or (value < 0 and not signed):
            rule = "must be a finite number" + ("" if signed else ", at least 0")
            raise ParameterError(rule, place=name, got=value)

    def _check_order(self, least: str, most: str) -> None:
        low, high = getattr(self, least), getattr(self, most)
        if low is not None and high is not None and low > high:
            raise ParameterError(f"must not be above {most}, {high:g}", place=least, got=low)

    @property
    def asks_for_heights(self) -> bool:
        """Whether points without z cannot be judged."""
        return self.min_height is not None or self.max_height is not None

    @property
    def reach(self) -> float | None:
        """How far from the robot beams clear, metres; None if that has no limit."""
        return self.max_range if self.raytrace_range is None else self.raytrace_range
