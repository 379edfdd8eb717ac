"""Stage ``window``: a part of a grid, or more than the grid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import POINT, VALUE, Parameters, Words, stage
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.canvas import FieldGrid, cut_out, on_canvas, replaced
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import MOST_CELLS, Frame, Point, Region, region_of
from mapdeal.grid.framed import Framed, ValueGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.resample import is_turned, region_on_lattice

G = TypeVar("G", bound=ValueGrid | FieldGrid | Reach)


def _cells(grid: Any, parameters: Parameters) -> Iterator[int]:
    """Yield the cells of the window, and those that it shares, which are cut out first."""
    frame: Frame | None = parameters["like"]
    if frame is None:
        corner, center = parameters["corner"], parameters["at"]
        frame = region_of(
            grid.frame, parameters["size"], corner_xy=corner, center_xy=center
        ).frame_in(grid.frame)
    count = frame.height * frame.width
    if count <= MOST_CELLS:  # more are refused by the window
        yield count + min(count, grid.shape[0] * grid.shape[1])


def _check(parameters: Parameters) -> Parameters:
    size, at, corner = (parameters[name] for name in ("size", "at", "corner"))
    if parameters["like"] is not None:
        if (size, at, corner) != (None, None, None):
            raise ParameterError("cannot be given together with size, at, corner", place="like")
    elif size is None:
        raise ParameterError("one of the two is required", place="size, like")
    elif at is None and corner is None:
        raise ParameterError("one of the two is required", place="at, corner")
    elif at is not None and corner is not None:
        raise ParameterError("cannot be given together with corner", place="at")
    return {}


@stage(
    name="window",
    summary="Copy a part of a map, or an area larger than the map.",
    details="Cells beyond the map are unknown; beyond a distance field there is no distance. The "
    "window lies along the map's own axes and begins with the cell that contains its lower left "
    "corner, so that cells keep their places.",
    title=lambda _: "window",
    memory=6.0,
    cells=_cells,
    edits=True,
    moves=True,
    settled=_check,
)
def window(
    grid: G,
    *,
    size_xy: Annotated[Point, POINT, Words("WX,WY", name="size")] | None = None,
    corner_xy: Annotated[Point, POINT, Words(name="corner")] | None = None,
    center_xy: Annotated[Point, POINT, Words(name="at")] | None = None,
    frame: Annotated[Frame, Words("MAP", name="like")] | None = None,
    default: Annotated[int, VALUE] | None = None,
) -> G:
    """Return a rectangular part of a grid, which may extend beyond it.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or DistanceField
        Grid to copy from.
    size_xy : tuple of float
        Extent along columns and rows, metres. It is rounded up to whole cells.
    corner_xy : tuple of float, optional
        Corner at the first cell, map frame, metres: the lower left one if the map has no yaw. The
        window begins at the cell that contains it, so that cells keep their places whatever the
        yaw.
    center_xy : tuple of float, optional
        Or the centre of the window, map frame, metres, from which the corner is half the size away.
    frame : Frame, optional
        Map with the same cells whose extent to use, instead of a size and a place. It is the
        frame of this map, whose cells coincide with those of `grid`.
    default : int, optional
        Value of cells beyond the map, on its scale; unknown if not given. Not allowed for a
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
    fill = default_of(grid, default)
    if frame is not None:
        if (size_xy, corner_xy, center_xy) != (None, None, None):
            raise ParameterError("takes the place of size, corner and center", place="frame")
        place = region_on_lattice(grid.frame, frame)
        if place is None:
            raise ParameterError(_other_cells(grid.frame, frame), place="frame")
        return copied(grid, place, frame, fill=fill, what="window")
    if size_xy is None:
        raise ParameterError("must be given, or a frame", place="size")
    region = region_of(grid.frame, size_xy, corner_xy=corner_xy, center_xy=center_xy)
    return copied(grid, region, region.frame_in(grid.frame), fill=fill, what="window")


def _other_cells(lattice: Frame, frame: Frame) -> str:
    if frame.resolution != lattice.resolution:
        own, other = lattice.resolution, frame.resolution
        return f"must have cells of {own:g} m as the grid has, not of {other:g} m"
    if is_turned(lattice, frame.origin[2]):
        return f"must have the grid's yaw, {lattice.origin[2]:g} rad, not {frame.origin[2]:g} rad"
    return "the edges of the cells must coincide: the origins are not whole cells apart"


def default_of(grid: Framed, value: int | None) -> int | None:
    """Return a value for cells beyond a grid, which must be on its scale; None for unknown."""
    if value is None:
        return None
    if not isinstance(grid, ValueGrid):
        raise ParameterError("a distance field takes none", place="default", got=value)
    return grid.accept_value(value, "default")


def copied(grid: G, region: Region, frame: Frame, *, fill: int | None, what: str) -> G:
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
    emit_warning(f"{what}: {text}", stacklevel=5)
    value = grid.unknown_value if fill is None else fill
    values: NDArray[np.generic] = np.full(frame.shape, value, dtype=grid.values.dtype)
    return grid.with_values(values, frame.origin)
