"""Maps with larger or smaller cells."""

from __future__ import annotations

from typing import TypeVar

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import MOST_CELLS, Frame, cells_to_cover, check_resolution
from mapdeal.grid.framed import ValueGrid
from mapdeal.grid.resample import ResamplingRule, check_rule, check_values, resampled

V = TypeVar("V", bound=ValueGrid)


def rescale(grid: V, resolution: float, *, rule: ResamplingRule = "area") -> V:
    """Resample a map or costmap to another resolution.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rescale.
    resolution : float
        Side of the new cells, metres.
    rule : {'area', 'nearest'}
        ``area``: a cell gets the largest value above 0 that it overlaps, so that no obstacle is
        lost; otherwise it is free or unknown, as the grid is at its centre. ``nearest``: a cell
        gets the value at its centre; in a coarser map, thin walls may get gaps or vanish.

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
