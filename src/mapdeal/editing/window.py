"""Parts of a grid: windows that are copied, other origins, regions that are reset."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FindingError, ParameterError, emit_warning
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.canvas import FieldGrid, cut_out, on_canvas, replaced
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Frame, Point, Region, check_point, region_of
from mapdeal.grid.framed import Framed, ValueGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.resample import is_turned, region_on_lattice

G = TypeVar("G", bound=ValueGrid | FieldGrid | Reach)
V = TypeVar("V", bound=ValueGrid)
D = TypeVar("D", bound=ValueGrid | BitMap)


def window(
    grid: G,
    *,
    size_xy: Point | None = None,
    corner_xy: Point | None = None,
    center_xy: Point | None = None,
    frame: Frame | None = None,
    default: int | None = None,
) -> G:
    """Return a rectangular part of a grid, which may extend beyond it.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or DistanceField
        Grid to copy from.
    size_xy : tuple of float
        Width and height along the grid's own axes, rounded up to whole cells, metres.
    corner_xy : tuple of float, optional
        Lower left corner in the map frame, metres. The window begins at the cell that contains
        it, so that cells keep their places whatever the yaw.
    center_xy : tuple of float, optional
        Centre in the map frame, metres, from which the corner is half the size away; instead of
        `corner_xy`.
    frame : Frame, optional
        Frame of another grid whose cells coincide with those of `grid`; instead of size and
        corner.
    default : int, optional
        Value of cells outside `grid`, on its scale; unknown if not given. Not allowed for a
        distance field, which is nan there.

    Returns
    -------
    OccupancyGrid, Costmap or DistanceField
        Grid of the same kind.

    Raises
    ------
    ParameterError
        If not exactly one of `corner_xy`, `center_xy` and `frame` is given, a number is not
        finite, the size is not positive, the cells of `frame` do not coincide with those of
        `grid`, or a window of a distance field contains none of its distances.

    Warns
    -----
    MapdealWarning
        If the window and the grid have no cell in common.

    References
    ----------
    ``copyCostmapWindow`` of costmap_2d, which fails if the window touches an upper edge, after
    discarding the destination's cells, and moves the cells by up to one cell to the requested
    corner.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 1, 2], [3, 4, 5]], 0.5, (1.0, 2.0, 0.0))
    >>> part = window(grid, corner_xy=(1.6, 2.5), size_xy=(1.0, 1.0))
    >>> part.occupancy.tolist(), part.origin
    ([[4, 5], [-1, -1]], (1.5, 2.5, 0.0))
    """
    fill = None if default is None else _default_of(grid, default)
    if frame is not None:
        if (size_xy, corner_xy, center_xy) != (None, None, None):
            raise ParameterError("takes the place of size, corner and center", place="frame")
        place = region_on_lattice(grid.frame, frame)
        if place is None:
            raise ParameterError(_other_cells(grid.frame, frame), place="frame")
        return _copied(grid, place, frame, fill=fill, what="window")
    if size_xy is None:
        raise ParameterError("must be given, or a frame", place="size")
    region = region_of(grid.frame, size_xy, corner_xy=corner_xy, center_xy=center_xy)
    return _copied(grid, region, region.frame_in(grid.frame), fill=fill, what="window")


def shift_origin(grid: V, origin_xy: Point, *, default: int | None = None) -> V:
    """Move a grid to another origin at the same size, like a rolling window.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to move; cells inside both the old and the new extent are kept.
    origin_xy : tuple of float
        Point in the map frame, metres. The new origin is the corner of the cell of the grid's
        lattice that contains it: grids are shifted by whole cells.
    default : int, optional
        Value of all other cells, on the grid's scale; unknown if not given.

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
    fill = None if default is None else _default_of(grid, default)
    region = region_of(grid.frame, grid.frame.size_xy, corner_xy=check_point(origin_xy, "origin"))
    region = region._replace(height=grid.shape[0], width=grid.shape[1])
    return _copied(grid, region, region.frame_in(grid.frame), fill=fill, what="origin")


def reset_region(
    grid: D,
    *,
    size_xy: Point,
    corner_xy: Point | None = None,
    center_xy: Point | None = None,
    value: int | None = None,
    strict: bool = False,
) -> D:
    """Return a grid in which one region is set to a single value.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or BitMap
        Grid to change.
    size_xy, corner_xy, center_xy : tuple of float
        Region, as in `window`.
    value : int, optional
        Value on the grid's scale; unknown if not given. Required for a bit map, which has no
        unknown cells.
    strict : bool
        Whether a region that extends beyond the grid is an error; nothing is changed then.

    Raises
    ------
    ParameterError
        As in `window`, or if `value` is not on the grid's scale or is missing for a bit map.
    FindingError
        If `strict` is set and the region extends beyond the grid.

    Warns
    -----
    MapdealWarning
        If `strict` is not set and the region extends beyond the grid.

    References
    ----------
    ``resetMap`` of costmap_2d and ``resetMapToValue`` of Nav2.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 0, 0], [0, 0, 0]], 0.5, (1.0, 2.0, 0.0))
    >>> region = {"corner_xy": (1.5, 2.0), "size_xy": (0.5, 1.0)}
    >>> reset_region(grid, value=100, **region).occupancy.tolist()
    [[0, 100, 0], [0, 100, 0]]
    """
    if value is not None:
        number = grid.accept_value(value)
    elif isinstance(grid, BitMap):
        raise ParameterError("is needed, 0 or 100: a bit map has no unknown cells", place="value")
    else:
        number = grid.unknown_value
    region = region_of(grid.frame, size_xy, corner_xy=corner_xy, center_xy=center_xy)
    rows, cols = region.shared_with(grid.shape)
    if (rows.stop - rows.start, cols.stop - cols.start) != region[2:]:
        if strict:
            rule = "reaches beyond the map; nothing was changed"
            raise FindingError(rule, place="region")
        outside = rows.start == rows.stop or cols.start == cols.stop
        text = "lies outside of the map" if outside else "reaches beyond the map, it is clipped"
        emit_warning(f"region: {text}", stacklevel=2)
    if isinstance(grid, BitMap):
        mask = grid.to_mask()
        mask[rows, cols] = number
        return grid.with_packed(np.packbits(mask, axis=1))
    values = grid.values.copy()
    values[rows, cols] = number
    return grid.with_values(values)


def blank(grid: D, value: int = 0) -> D:
    """Return a grid of the same kind and geometry with the same value in every cell.

    Useful for drawing a mask: a mask that is unknown outside its shapes changes nothing there.
    """
    if isinstance(grid, BitMap):
        return grid.fill(bool(grid.accept_value(value, "background")))
    return grid.with_values(np.full_like(grid.values, grid.accept_value(value, "background")))


def _other_cells(lattice: Frame, frame: Frame) -> str:
    if frame.resolution != lattice.resolution:
        own, other = lattice.resolution, frame.resolution
        return f"must have cells of {own:g} m as the grid has, not of {other:g} m"
    if is_turned(lattice, frame.origin[2]):
        return f"must have the grid's yaw, {lattice.origin[2]:g} rad, not {frame.origin[2]:g} rad"
    return "the edges of the cells must coincide: the origins are not whole cells apart"


def _default_of(grid: Framed, value: int) -> int:
    if not isinstance(grid, ValueGrid):
        raise ParameterError("a distance field takes none", place="default", got=value)
    return grid.accept_value(value, "default")


def _copied(grid: G, region: Region, frame: Frame, *, fill: int | None, what: str) -> G:
    """Return the cells of a region, whose place in the map frame is `frame`."""
    if not isinstance(grid, (ValueGrid, DistanceField)):
        raise ParameterError("takes a map, a costmap or a distance field", source="window")
    known = Region(0, 0, *grid.shape)
    if isinstance(grid, DistanceField) and grid.region is not None:
        known = grid.region
    row, col = max(region.row, known.row), max(region.col, known.col)
    shared = Region(
        row,
        col,
        min(region.row + region.height, known.row + known.height) - row,
        min(region.col + region.width, known.col + known.width) - col,
    )
    if shared.height <= 0 or shared.width <= 0:
        return _beside(grid, frame, fill=fill, what=what)
    layers = {name: cut_out(getattr(grid, name), shared) for name in grid.layer_names}
    part = replaced(grid, origin=shared.frame_in(grid.frame).origin, **layers)
    return on_canvas(part, frame, fill=fill)


def _beside(grid: G, frame: Frame, *, fill: int | None, what: str) -> G:
    if not isinstance(grid, ValueGrid):
        raise ParameterError("no cell of it has a distance", place=what)
    text = "lies outside of the map, no cell is kept"
    emit_warning(f"{what}: {text}", stacklevel=4)
    value = grid.unknown_value if fill is None else fill
    values: NDArray[np.generic] = np.full(frame.shape, value, dtype=grid.values.dtype)
    return grid.with_values(values, frame.origin)
