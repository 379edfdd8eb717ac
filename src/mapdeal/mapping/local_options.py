"""Options for local maps from point clouds."""

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
    """Options for making a local map from point clouds.

    Parameters
    ----------
    frame : {'robot', 'map'}
        Frame of the cloud's coordinates: ``robot``, with x ahead and y to the left, or ``map``.
    offset : tuple of float
        x and y to subtract from the points' coordinates in the map frame, metres.
    size : tuple of float
        Extent of the map along x and y, rounded up to whole cells, metres.
    resolution : float
        Side of a cell, metres.
    min_height, max_height : float, optional
        Lowest and highest z of the points to use, in the cloud's own coordinates, metres.
    min_range, max_range : float, optional
        Smallest and largest horizontal distance from the robot of the points to use, metres.
    raytrace_range : float, optional
        Distance from the robot up to which beams clear cells, metres; `max_range` if not given.
    unknown : {'keep', 'free'}
        Whether cells that nothing has seen stay unknown or become free. Without a global map,
        `local_map` and `LocalMapper` always make them free.

    Raises
    ------
    ParameterError
        If a number is not finite or has the wrong sign, or a minimum exceeds its maximum.
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
        """Whether heights are limited, so that points need a z coordinate."""
        return self.min_height is not None or self.max_height is not None

    @property
    def reach(self) -> float | None:
        """Distance from the robot up to which beams clear cells, metres; None if unlimited."""
        return self.max_range if self.raytrace_range is None else self.raytrace_range
