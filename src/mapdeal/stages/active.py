"""Stage ``active``: the known part of a map."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import AT_LEAST_0, CELLS, METRES, InSimulation, stage
from mapdeal.errors import MalformedInputError
from mapdeal.grid.canvas import cut_out, on_canvas
from mapdeal.grid.frame import Region, cells_to_cover
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import swept
from mapdeal.kernels.components import drop_small_groups

Mask = NDArray[np.bool_]


@stage(
    name="active",
    summary="Crop a map to its known part, the active region.",
    title=lambda _: "active region",
    memory=1.5,
    passes=1,
    is_whole=lambda parameters: parameters["min_component"] > 1,
    is_smaller=lambda parameters: parameters["canvas"] == "crop",
    in_simulation=InSimulation({}, is_added=True),
)
def active_region(
    grid: OccupancyGrid,
    *,
    margin: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    canvas: Literal["crop", "full"] = "crop",
    min_component: Annotated[int, AT_LEAST_0, CELLS] = 0,
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
        If no cell is known, or no group of known cells is large enough.

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
    rows, cols = box_around(*_known_lines(grid, min_component), margin, grid.resolution)
    region = Region(rows.start, cols.start, rows.stop - rows.start, cols.stop - cols.start)
    box = OccupancyGrid(
        cut_out(grid.occupancy, region), grid.resolution, region.frame_in(grid.frame).origin
    )
    return on_canvas(box, grid.frame) if canvas == "full" else box


def _known_lines(grid: OccupancyGrid, min_component: int) -> tuple[Mask, Mask]:
    """Return in which rows and in which columns anything is known that counts."""
    if min_component > 1:
        known = drop_small_groups(np.asarray(grid.occupancy) != UNKNOWN, min_component)
        if not known.any():
            rule = f"no active cells: no group of {min_component} known cells or more"
            raise MalformedInputError(rule)
        return np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))
    in_rows, in_cols = np.zeros(grid.shape[0], dtype=bool), np.zeros(grid.shape[1], dtype=bool)
    for block in swept(grid.occupancy):
        known = grid.occupancy[block] != UNKNOWN
        in_rows[block] = known.any(axis=1)
        in_cols |= known.any(axis=0)
    return in_rows, in_cols


def box_around(
    rows: NDArray[np.bool_], cols: NDArray[np.bool_], margin: float, resolution: float
) -> tuple[slice, slice]:
    """Return the rows and columns of a box, given in which of them anything is known."""
    if not rows.any():
        raise MalformedInputError("no active cells: every cell is unknown")
    # A margin of more than the map is as good as one of the map.
    grow = cells_to_cover(min(margin, max(len(rows), len(cols)) * resolution), resolution)
    return _span(rows, grow), _span(cols, grow)


def _span(has_known: NDArray[np.bool_], grow: int) -> slice:
    """Return the half open range of the True entries, grown and clipped."""
    indices = np.flatnonzero(has_known)
    return slice(max(int(indices[0]) - grow, 0), min(int(indices[-1]) + 1 + grow, len(has_known)))
