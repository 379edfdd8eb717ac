"""Stages ``active``, ``window`` and ``shift``, which crop, extend or move a grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from mapdeal import command, errors
from mapdeal.grid import canvas as canvases, field, frame as frames, reach
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels import arrays, blocks, components

G = TypeVar("G", bound=frames.ValueGrid | canvases.FieldGrid | reach.Reach)
V = TypeVar("V", bound=frames.ValueGrid)


@command.stage(
    name="active",
    group="Maps, distance fields, costmaps",
    example="mapdeal active examples/maps/arena.yaml -o out/active.yaml --margin 0.5",
    summary="Crop a map to its known part, the active region.",
    title=lambda _: "active region",
    memory=1.5,
    passes=1,
    is_whole=lambda parameters: parameters["min_component"] > 1,
    is_smaller=lambda parameters: parameters["canvas"] == "crop",
    in_simulation=command.InSimulation({}, is_added=True),
)
def active_region(
    grid: OccupancyGrid,
    *,
    margin: Annotated[float, command.AT_LEAST_0, command.METRES] = 0.0,
    canvas: Literal["crop", "full"] = "crop",
    min_component: Annotated[int, command.AT_LEAST_0, command.CELLS] = 0,
) -> OccupancyGrid:
    """Crop a map to the bounding box of its known cells.

    Maps of simulated worlds often cover a large area of fixed size; the box is the explored part.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    margin : float
        Margin around the box, metres. It is added on every side, rounded up to whole cells, and
        clipped to the grid.
    canvas : {'crop', 'full'}
        Extent of the result: the box (crop), or the full map extent (full). ``crop``: the grid
        shrinks to the box and its origin moves with it, whatever the yaw. ``full``: the grid keeps
        its size, and cells outside the box become unknown.
    min_component : int
        Least size of an 8-connected group of known cells that extends the box, cells. Smaller
        groups, such as stray beams, do not enlarge the box; inside it, their cells are kept.

    Returns
    -------
    OccupancyGrid
        The cropped map, or the map with unknown cells around the box.

    Raises
    ------
    MalformedInputError
        If no cell is known, or all groups of known cells are too small.

    References
    ----------
    ``crop_map`` of ROS map_server, which applies the same rule to pixels.

    Examples
    --------
    >>> grid = OccupancyGrid([[-1, -1, -1, -1], [-1, 0, 100, -1]], 0.5, (1.0, 2.0, 0.0))
    >>> region = active_region(grid)
    >>> region.occupancy.tolist(), region.origin
    ([[0, 100]], (1.5, 2.5, 0.0))
    """
    # a larger margin than the map has no further effect
    margin = min(margin, max(grid.shape) * grid.resolution)
    grow = frames.cells_to_cover(margin, grid.resolution)
    region = frames.Region.spanning(*_known_lines(grid, min_component), grow=grow)
    if region is None:
        raise errors.MalformedInputError("no active cells: every cell is unknown")
    origin = region.frame_in(grid.frame).origin
    box = OccupancyGrid(canvases.cut_out(grid.occupancy, region), grid.resolution, origin)
    return canvases.on_canvas(box, grid.frame) if canvas == "full" else box


def _known_lines(grid: OccupancyGrid, min_component: int) -> tuple[arrays.Mask, arrays.Mask]:
    """Return which rows and which columns have known cells of large enough groups."""
    if min_component > 1:
        known = components.drop_small_groups(np.asarray(grid.occupancy) != UNKNOWN, min_component)
        if not known.any():
            rule = f"no active cells: no group of {min_component} known cells or more"
            raise errors.MalformedInputError(rule)
        return np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))
    in_rows, in_cols = np.zeros(grid.shape[0], dtype=bool), np.zeros(grid.shape[1], dtype=bool)
    for block in blocks.swept(grid.occupancy):
        known = grid.occupancy[block] != UNKNOWN
        in_rows[block] = known.any(axis=1)
        in_cols |= known.any(axis=0)
    return in_rows, in_cols


def _cells(grid: Any, parameters: command.Parameters) -> Iterator[int]:
    size, corner, center = (parameters[name] for name in ("size", "corner", "at"))
    count = frames.region_of(grid.frame, size, corner_xy=corner, center_xy=center).cells
    if count <= frames.MOST_CELLS:  # the window refuses more
        yield count + min(count, math.prod(grid.shape))


@command.stage(
    name="window",
    group="Changing a map",
    example="mapdeal window examples/maps/office.yaml -o out/w.yaml --at 0.5,0.3 --size 8,8",
    summary="Copy a part of a map, or an area larger than the map.",
    details="Cells beyond the map are unknown; beyond a distance field there is no distance. The "
    "window lies along the map's own axes and begins with the cell that contains its lower left "
    "corner, so that cells keep their places.",
    title=lambda _: "window",
    memory=6.0,
    cells=_cells,
    edits=True,
    moves=lambda _: True,
    derived=lambda parameters: command.check_one_of(parameters, "at", "corner"),
)
def window(
    grid: G,
    *,
    size_xy: Annotated[frames.Point, command.POINT, command.Words("WX,WY", name="size")],
    corner_xy: Annotated[frames.Point, command.POINT, command.Words(name="corner")] | None = None,
    center_xy: Annotated[frames.Point, command.POINT, command.Words(name="at")] | None = None,
    default: Annotated[int, command.VALUE] | None = None,
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
        window begins at the cell that contains it, so that cells keep their places at any yaw.
    center_xy : tuple of float, optional
        Centre of the window, map frame, metres, instead of its corner.
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
        If not exactly one of `corner_xy` and `center_xy` is given, a number is not finite, the
        size is 0 or less, or a field holds only nan in the window.

    Warns
    -----
    MapdealWarning
        If the window and the grid have no cell in common.

    References
    ----------
    ``copyCostmapWindow`` of costmap_2d, which fails at upper edges and moves cells by up to one.

    Examples
    --------
    >>> grid = OccupancyGrid([[0, 1, 2], [3, 4, 5]], 0.5, (1.0, 2.0, 0.0))
    >>> part = window(grid, corner_xy=(1.6, 2.5), size_xy=(1.0, 1.0))
    >>> part.occupancy.tolist(), part.origin
    ([[4, 5], [-1, -1]], (1.5, 2.5, 0.0))
    """
    fill = default_of(grid, default)
    region = frames.region_of(grid.frame, size_xy, corner_xy=corner_xy, center_xy=center_xy)
    return copied(grid, region, region.frame_in(grid.frame), fill, "window")


def default_of(grid: frames.Framed, value: int | None) -> int | None:
    """Return a value for cells beyond a grid, checked against its scale; None for unknown."""
    if value is None:
        return None
    if not isinstance(grid, frames.ValueGrid):
        raise errors.ParameterError("a distance field takes none", place="default", got=value)
    return grid.accept_value(value, "default")


def copied(grid: G, region: frames.Region, frame: frames.Frame, fill: int | None, name: str) -> G:
    if not isinstance(grid, (frames.ValueGrid, field.DistanceField)):
        raise errors.ParameterError("takes a map, a costmap or a distance field", source="window")
    box = grid.region if isinstance(grid, field.DistanceField) else None
    known = box or frames.Region(0, 0, *grid.shape)
    row, col = max(region.row, known.row), max(region.col, known.col)
    top = min(region.row + region.height, known.row + known.height)
    right = min(region.col + region.width, known.col + known.width)
    shared = frames.Region(row, col, top - row, right - col)
    if shared.height <= 0 or shared.width <= 0:
        if not isinstance(grid, frames.ValueGrid):
            raise errors.ParameterError("no cell of it has a distance", place=name)
        errors.emit_warning(f"{name}: lies outside the map, so no cell is kept")
        value = grid.unknown_value if fill is None else fill
        values: arrays.Array = np.full(frame.shape, value, dtype=grid.values.dtype)
        return grid.with_values(values, frame.origin)
    layers = {name: canvases.cut_out(getattr(grid, name), shared) for name in grid.layer_names}
    part = canvases.replaced(grid, origin=shared.frame_in(grid.frame).origin, **layers)
    return canvases.on_canvas(part, frame, fill=fill)


@command.stage(
    name="shift",
    group="Changing a map",
    example="mapdeal shift examples/maps/office.yaml -o out/shifted.yaml --origin -10,-6.5",
    product="shifted",
    summary="Move the window of a map or costmap to a new origin.",
    details="As costmap_2d's updateOrigin: cells that both windows have in common are kept. The "
    "new origin is the corner of the cell that contains the given point.",
    title=lambda _: "shifted",
    memory=6.0,
    edits=True,
    moves=lambda _: True,
)
def shift_origin(
    grid: V,
    origin_xy: Annotated[frames.Point, command.POINT, command.Words(name="origin")],
    *,
    default: Annotated[int, command.VALUE] | None = None,
) -> V:
    """Move a grid to another origin at the same size, like a rolling window.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to move; cells inside both the old and the new extent are kept.
    origin_xy : tuple of float
        New origin, metres; the map moves by whole cells. The result begins at the corner of the
        cell that contains this point.
    default : int, optional
        Value of new cells, on the grid's scale; unknown if not given.

    Raises
    ------
    ParameterError
        If a coordinate is infinite or nan, or `default` is off the scale.

    Warns
    -----
    MapdealWarning
        If no cell is kept.

    References
    ----------
    ``updateOrigin`` of costmap_2d, which truncates: 0.3 / 0.1 becomes two cells there.

    Examples
    --------
    >>> grid = OccupancyGrid([[1, 2, 3]], 0.1, (0.0, 2.0, 0.0))
    >>> shifted = shift_origin(grid, (0.2, 2.0), default=0)
    >>> shifted.occupancy.tolist(), shifted.origin
    ([[3, 0, 0]], (0.2, 2.0, 0.0))
    """
    canvases.check_values(grid)
    fill = default_of(grid, default)
    corner = frames.check_point(origin_xy, "origin")
    region = frames.region_of(grid.frame, grid.frame.size_xy, corner_xy=corner)
    region = region._replace(height=grid.shape[0], width=grid.shape[1])
    return copied(grid, region, region.frame_in(grid.frame), fill, "origin")
