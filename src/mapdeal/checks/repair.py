"""A map without the traps that can be taken out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mapdeal.checks.facts import MAP_SAVER_UNKNOWN, GridFacts, PairFacts
from mapdeal.checks.rounding import without_rounding_noise
from mapdeal.formats.dialects import cells_of
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import region_around
from mapdeal.grid.resample import is_turned, obstacles_in, sampled
from mapdeal.grid.values import OCCUPIED, UNKNOWN

_FREE_THRESH = 0.196
"""Below the shade of grey 205, which map_saver writes for unknown."""


def repaired(pair: PairFacts | None, cells: GridFacts) -> tuple[OccupancyGrid, list[str]]:
    """Return a map as it should be, and what was changed, a line each.

    Parameters
    ----------
    pair : PairFacts or None
        Of a map_server pair.
    cells : GridFacts
        Of any map.

    Returns
    -------
    grid : OccupancyGrid
        With grey 205 unknown, resolution and origin without the noise of rounding, and no yaw:
        the map is resampled on the lattice of its resolution, so that no obstacle is lost.
        Written as a new pair it has a relative path and the usual thresholds.
    done : list of str
        What was changed.
    """
    grid, done = cells.grid, []
    if pair is not None and pair.metadata.mode != "raw":
        thresholds = replace(
            pair.metadata, free_thresh=min(_FREE_THRESH, pair.metadata.free_thresh)
        )
        read_again = cells_of(pair.picture, thresholds, "nav2")
        freed = MAP_SAVER_UNKNOWN in pair.greys and not np.array_equal(read_again, grid.occupancy)
        if freed:
            count = int(np.count_nonzero(read_again != grid.occupancy))
            done.append(f"{count} cells of unknown grey are not free any more")
            grid = grid.with_values(read_again)
    resolution = without_rounding_noise(grid.resolution) or grid.resolution
    x, y, yaw = (without_rounding_noise(value) or value for value in grid.origin)
    if (resolution, (x, y, yaw)) != (grid.resolution, grid.origin):
        done.append(f"resolution {resolution!r}, origin {x!r}, {y!r}, {yaw!r} without noise")
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, yaw))
    if is_turned(grid.frame):
        done.append(f"yaw {yaw:g} rad is in the cells now")
        grid = _without_yaw(grid)
    elif yaw:
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, 0.0))
    return grid, done


def _without_yaw(grid: OccupancyGrid) -> OccupancyGrid:
    """Return a map on a lattice along the axes, with every obstacle of the turned one."""
    lattice = Frame(1, 1, grid.resolution)
    frame = region_around(lattice, grid.frame).frame_in(lattice)
    values, inside = sampled(frame, grid.occupancy, grid.frame)
    values[~inside] = UNKNOWN
    values[obstacles_in(frame, grid.occupied(), grid.frame)] = OCCUPIED
    return OccupancyGrid(values, frame.resolution, frame.origin)
