"""A map without the traps that can be taken out of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mapdeal.checks.facts import PairFacts
from mapdeal.checks.rounding import without_rounding_noise
from mapdeal.errors import MalformedInputError, kept_warnings
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.dialects import cells_of
from mapdeal.formats.image import open_strips
from mapdeal.formats.map_remarks import USUAL_FREE_THRESH, FreedCells, remark_on_freed
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.npz import read_npz
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import region_around
from mapdeal.grid.resample import is_turned, resampled

_COSTS = "holds costs, which are not repaired"

_PER_CELL = 3
"""Bytes: the cells, and what they become while they are written."""

_PER_CELL_OF_TURNED, _PER_NEW_CELL = 5, 3
"""Bytes, of a turned map that is resampled and of the new one."""


def repaired(
    path: Path, pair: PairFacts | None, *, max_cells: int | None = None
) -> tuple[OccupancyGrid, list[str]]:
    """Return a map as it should be, and what was changed, a line each."""
    done: list[str] = []
    with kept_warnings():  # all was told when it was read first
        grid = _read_again(path, pair, max_cells, done)
    claim(path, _PER_CELL * grid.occupancy.size)
    resolution = without_rounding_noise(grid.resolution) or grid.resolution
    x, y, yaw = (without_rounding_noise(value) or value for value in grid.origin)
    if (resolution, (x, y, yaw)) != (grid.resolution, grid.origin):
        done.append(f"resolution {resolution!r}, origin {x!r}, {y!r}, {yaw!r} without noise")
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, yaw))
    if is_turned(grid.frame):
        done.append(f"yaw {yaw:g} rad is in the cells now")
        grid = _without_yaw(grid, path)
    elif yaw:
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, 0.0))
    return grid, done


def _read_again(
    path: Path, pair: PairFacts | None, max_cells: int | None, done: list[str]
) -> OccupancyGrid:
    if pair is not None:
        return _map_of_pair(pair, max_cells, done)
    grid = read_npz(path, max_cells=max_cells)
    if isinstance(grid, Costmap):
        raise MalformedInputError(_COSTS, source=path)
    return grid if isinstance(grid, OccupancyGrid) else grid.grid


def _map_of_pair(pair: PairFacts, max_cells: int | None, done: list[str]) -> OccupancyGrid:
    """Read a map again, with a lower free_thresh if map_saver's unknown is free."""
    if pair.metadata.cost_scale is not None:
        raise MalformedInputError(_COSTS, source=pair.path)
    given = mended = pair.metadata
    freed: dict[Dialect, FreedCells] = {"nav2": pair.pixels.freed["nav2"]}
    if remark_on_freed(freed, pair.pixels.size, given) is not None:
        mended = replace(given, free_thresh=min(USUAL_FREE_THRESH, given.free_thresh))
    changed = 0
    with open_strips(pair.image_path, max_cells=max_cells) as strips:
        occupancy = np.empty(strips.shape, dtype=np.int8)
        for rows, picture in strips.placed():
            cells_of(picture, mended, "nav2", out=occupancy[rows])
            if mended is not given:
                before = cells_of(picture, given, "nav2")
                changed += int(np.count_nonzero(before != occupancy[rows]))
    if changed:
        cells = "1 cell is" if changed == 1 else f"{changed} cells are"
        done.append(f"{cells} now unknown instead of free: map_saver's grey for unknown")
    return OccupancyGrid(occupancy, given.resolution, given.origin)


def _without_yaw(grid: OccupancyGrid, path: Path) -> OccupancyGrid:
    """Return a map on a lattice along the axes, with every obstacle of the turned one."""
    lattice = Frame(1, 1, grid.resolution)
    region = region_around(lattice, grid.frame)
    cells = _PER_CELL_OF_TURNED * grid.occupancy.size + _PER_NEW_CELL * region.cells
    claim(path, cells + PIECES)
    return resampled(grid, region.frame_in(lattice))
