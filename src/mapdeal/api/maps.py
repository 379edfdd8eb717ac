"""Maps that functions take as files or as grids, and transforms as types or as numbers."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import as_occupancy, read_map
from mapdeal.pipeline.settings import Settings

Map = str | PathLike[str] | Grid
"""A map's file, or the map itself."""


def occupancy_of(map_: Map, settings: Settings, *, place: str, name: str) -> OccupancyGrid:
    """Return a map given as a file or a grid; fields and costs as ROS would publish them."""
    if isinstance(map_, str | PathLike):
        map_ = read_map(
            Path(map_),
            dialect=settings.dialect,
            max_cells=settings.max_cells,
            max_memory=settings.max_memory,
        )
    if not isinstance(map_, Grid):
        raise ParameterError("takes files or grids", place=place, got=map_)
    return as_occupancy(map_, name)


def transform_of(given: object, *, place: str, or_file: bool = False) -> Transform | None:
    """Return a transform that may be given as x, y and yaw; None if none is given."""
    if given is None or isinstance(given, Transform):
        return given
    try:
        if isinstance(given, str):
            raise TypeError  # whose letters may be digits
        x, y, yaw = (float(number) for number in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        what = "a file, a transform" if or_file else "a transform"
        rule = f"must be {what}, or three numbers x, y, yaw"
        raise ParameterError(rule, place=place, got=given) from None
    return Transform(x, y, yaw)
