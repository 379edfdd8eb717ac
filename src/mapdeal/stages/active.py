"""Stage ``active``: the part of a map that anything is known of."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.grid.coordinates import cells_to_cover
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.neighbourhood import drop_small_groups
from mapdeal.stages.parameters import AT_LEAST_0, stage


@stage
def active_region(
    grid: OccupancyGrid,
    *,
    margin: Annotated[float, AT_LEAST_0] = 0.0,
    canvas: Literal["crop", "full"] = "crop",
    min_component: Annotated[int, AT_LEAST_0] = 0,
) -> OccupancyGrid:
    """Return the bounding box of all known cells.

    Maps of simulated worlds lie on a canvas of some predictable, large size; the box is the
    part that was explored.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    margin : float
        Metres to grow the box by on every side; it is clipped to the grid.
    canvas : {'crop', 'full'}
        ``crop``: the grid shrinks to the box and its origin moves with it, whatever the yaw.
        ``full``: the grid keeps its size, and cells outside of the box become unknown.
    min_component : int
        8-connected groups of known cells smaller than this don't count for the box, so that a
        stray beam does not blow it up. Inside of the box they stay.

    Returns
    -------
    OccupancyGrid

    Raises
    ------
    MalformedInputError
        If no cell is known, or none in a group large enough.

    References
    ----------
    Design document 000 takes the same box, with the bugs that the documentation of this stage
    lists; ``crop_map`` of ROS map_server is the same rule on pixels.

    Examples
    --------
    >>> grid = OccupancyGrid([[-1, -1, -1, -1], [-1, 0, 100, -1]], 0.5, (1.0, 2.0, 0.0))
    >>> region = active_region(grid)
    >>> region.occupancy.tolist(), region.origin
    ([[0, 100]], (1.5, 2.5, 0.0))
    """
    known = drop_small_groups(grid.occupancy != UNKNOWN, min_component)
    if not known.any() and min_component > 1:
        rule = f"no active cells: no group of {min_component} known cells or more"
        raise MalformedInputError(rule)
    in_rows, in_cols = np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))
    rows, cols = box_around(in_rows, in_cols, margin, grid.resolution)
    if canvas == "full":
        occupancy = np.full(grid.shape, UNKNOWN, dtype=np.int8)
        occupancy[rows, cols] = grid.occupancy[rows, cols]
        return OccupancyGrid(occupancy, grid.resolution, grid.origin)
    frame = grid.frame.window(
        rows.start, cols.start, rows.stop - rows.start, cols.stop - cols.start
    )
    return OccupancyGrid(grid.occupancy[rows, cols], grid.resolution, frame.origin)


def box_around(
    rows: NDArray[np.bool_], cols: NDArray[np.bool_], margin: float, resolution: float
) -> tuple[slice, slice]:
    """Return the rows and columns of a box, given in which of them anything is known.

    Raises
    ------
    MalformedInputError
        If nothing is known anywhere.
    """
    if not rows.any():
        raise MalformedInputError("no active cells: every cell is unknown")
    # A margin of more than the map is as good as one of the map.
    grow = cells_to_cover(min(margin, max(len(rows), len(cols)) * resolution), resolution)
    return _span(rows, grow), _span(cols, grow)


def _span(has_known: NDArray[np.bool_], grow: int) -> slice:
    """Return the half open range of the True entries, grown and clipped."""
    indices = np.flatnonzero(has_known)
    return slice(max(int(indices[0]) - grow, 0), min(int(indices[-1]) + 1 + grow, len(has_known)))
