"""Stage ``shift``: a grid of the same size at another origin."""

from __future__ import annotations

from typing import Annotated, TypeVar

from mapdeal.command import POINT, VALUE, Words, stage
from mapdeal.grid.frame import Point, check_point, region_of
from mapdeal.grid.framed import ValueGrid
from mapdeal.grid.resample import check_values
from mapdeal.stages.window import copied, default_of

V = TypeVar("V", bound=ValueGrid)


@stage(
    name="shift",
    product="shifted",
    summary="Move the window of a map or costmap to a new origin.",
    details="As costmap_2d's updateOrigin: cells that both windows have in common are kept. The "
    "new origin is the corner of the cell that contains the given point.",
    title=lambda _: "shifted",
    memory=6.0,
    edits=True,
    moves=True,
)
def shift_origin(
    grid: V,
    origin_xy: Annotated[Point, POINT, Words(name="origin")],
    *,
    default: Annotated[int, VALUE] | None = None,
) -> V:
    """Move a grid to another origin at the same size, like a rolling window.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to move; cells inside both the old and the new extent are kept.
    origin_xy : tuple of float
        New origin, metres; the map moves by whole cells. It is the corner of the cell of the grid's
        lattice that contains this point of the map frame.
    default : int, optional
        Value of new cells, on the grid's scale; unknown if not given.

    Raises
    ------
    ParameterError
        If a coordinate is not finite, or `default` is not on the scale.

    Warns
    -----
    MapdealWarning
        If no cell is kept.

    References
    ----------
    ``updateOrigin`` of costmap_2d, which truncates toward zero instead, so that 0.3 / 0.1 becomes
    two cells.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[1, 2, 3]], 0.1, (0.0, 2.0, 0.0))
    >>> shifted = shift_origin(grid, (0.2, 2.0), default=0)
    >>> shifted.occupancy.tolist(), shifted.origin
    ([[3, 0, 0]], (0.2, 2.0, 0.0))
    """
    check_values(grid)
    fill = default_of(grid, default)
    region = region_of(grid.frame, grid.frame.size_xy, corner_xy=check_point(origin_xy, "origin"))
    region = region._replace(height=grid.shape[0], width=grid.shape[1])
    return copied(grid, region, region.frame_in(grid.frame), fill=fill, what="origin")
