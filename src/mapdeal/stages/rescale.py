"""Stage ``rescale``: a map with larger or smaller cells."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, TypeVar

from mapdeal.command import ABOVE_0, METRES, Parameters, stage
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import MOST_CELLS, Frame, cells_to_cover, check_resolution
from mapdeal.grid.framed import ValueGrid
from mapdeal.grid.resample import ResamplingRule, check_rule, check_values, resampled

V = TypeVar("V", bound=ValueGrid)


def _cells(grid: ValueGrid, parameters: Parameters) -> Iterator[int]:
    """Yield the cells of both maps, of which the smaller one is there already."""
    count, made = (
        frame.height * frame.width
        for frame in (grid.frame, rescaled_frame(grid.frame, parameters["resolution"]))
    )
    yield max(count, made) + count


def _settled(parameters: Parameters) -> Parameters:
    check_resolution(parameters["resolution"])
    return {}


@stage(
    name="rescale",
    product="rescaled",
    summary="Write a map or costmap with larger or smaller cells.",
    details="Origin and yaw stay, and the new cells cover the whole map. With the rule area no "
    "obstacle is lost in a coarser map; nearest takes the value at the centre of each new cell.",
    title=lambda parameters: f"at {parameters['resolution']:g} m",
    memory=6.0,
    cells=_cells,
    is_whole=lambda _: True,
    edits=True,
    moves=True,
    settled=_settled,
)
def rescale(
    grid: V,
    resolution: Annotated[float, ABOVE_0, METRES],
    *,
    rule: ResamplingRule = "area",
) -> V:
    """Resample a map or costmap to another resolution.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rescale.
    resolution : float
        Side of the new cells, metres.
    rule : {'area', 'nearest'}
        Value of a new cell: the largest of all overlapped cells (area), so that no obstacle is
        lost, or the value at its centre (nearest). With ``area``, a cell that overlaps no value
        above 0 is free or unknown, as the grid is at its centre. With ``nearest``, in a coarser
        map, thin walls may get gaps or vanish.

    Returns
    -------
    OccupancyGrid or Costmap
        Grid of the same kind, origin and yaw. Its cells cover all of `grid`; cells that extend
        beyond it are unknown unless they overlap an obstacle or have their centre in `grid`. If
        an old cell is a whole number of new ones, these are copies of it.

    Raises
    ------
    ParameterError
        If the resolution is not allowed, the rule is unknown, or the result would have too many
        cells.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 0, 0, 100], [0, 0, -1, -1]], 0.05, (1.0, 2.0, 0.3))
    >>> rescale(grid, 0.1).occupancy.tolist()
    [[0, 100]]
    >>> rescale(grid, 0.025).shape
    (4, 8)
    """
    check_rule(rule)
    check_values(grid)
    frame = rescaled_frame(grid.frame, resolution)
    return grid if frame == grid.frame else resampled(grid, frame, rule=rule)


def rescaled_frame(frame: Frame, resolution: float) -> Frame:
    """Return the frame of the result of `rescale`.

    Examples
    --------
    >>> rescaled_frame(Frame(3, 5, 0.05, (1.0, 2.0, 0.3)), 0.1)
    Frame(height=2, width=3, resolution=0.1, origin=(1.0, 2.0, 0.3))
    """
    side = check_resolution(resolution)
    if side == frame.resolution:
        return frame
    width, height = (max(1, cells_to_cover(length, side)) for length in frame.size_xy)
    if height * width > MOST_CELLS:
        rule = f"the result must not have more than {MOST_CELLS} cells"
        raise ParameterError(rule, place="resolution", got=(width, height))
    return Frame(height, width, side, frame.origin)
