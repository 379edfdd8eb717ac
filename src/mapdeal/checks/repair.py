"""Traps taken out of a map: out of its cells, or out of its YAML file alone."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.checks.facts import PairFacts, without_rounding_noise
from mapdeal.errors import MalformedInputError, kept_warnings
from mapdeal.files.budget import PIECES, claim
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import is_turned, resampled
from mapdeal.maps.dialects import cells_of
from mapdeal.maps.images import open_strips
from mapdeal.maps.map_yaml import Dialect
from mapdeal.maps.npz import read_npz
from mapdeal.maps.remarks import USUAL_FREE_THRESH, FreedCells, remark_on_freed

_COSTS = "holds costs, which are not repaired"

_NUMBERS = ("resolution", "origin", "occupied_thresh", "free_thresh")

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


@dataclass(frozen=True)
class YamlRepair:
    values: Mapping[str, Any]
    done: tuple[str, ...]
    needs_cells: bool = False

    def __bool__(self) -> bool:
        return bool(self.values) or self.needs_cells


def yaml_repair(
    pair: PairFacts, frame: Frame | None, wanted: Collection[str]
) -> YamlRepair:  # fmt: skip
    """Return what takes traps out of a map's YAML file."""
    metadata, entries = pair.metadata, pair.entries
    values: dict[str, Any] = {}
    if "yaml.defaults" in wanted:
        filled_in = {
            "negate": int(metadata.negate),
            "occupied_thresh": metadata.occupied_thresh,
            "free_thresh": metadata.free_thresh,
        }
        values |= {key: value for key, value in filled_in.items() if key not in entries}
    if "yaml.number-as-text" in wanted:
        values |= {key: getattr(metadata, key) for key in _NUMBERS if _has_text(pair, key)}
    if "thresholds.unknown-becomes-free" in wanted and metadata.free_thresh > USUAL_FREE_THRESH:
        values["free_thresh"] = USUAL_FREE_THRESH
    if "yaml.resolution-noise" in wanted:
        values["resolution"] = _plain(metadata.resolution)
    needs_cells = False
    x, y, yaw = metadata.origin
    if "yaml.origin-noise" in wanted:
        x, y, yaw = (_plain(value) for value in (x, y, yaw))
    if "yaml.origin-yaw" in wanted and frame is not None:
        needs_cells = is_turned(frame)
        yaw = yaw if needs_cells else 0.0
    if (x, y, yaw) != metadata.origin or "yaml.nan-yaw" in wanted:
        values["origin"] = (x, y, yaw)
    if {"yaml.mode-case", "yaml.legacy-mode"} & set(wanted):
        values["mode"] = metadata.mode
    image = _image_name(pair, wanted)
    if image is not None:
        values["image"] = image
    geometry = {"resolution", "origin"} if needs_cells else set()  # of new cells: not known yet
    done = tuple(f"{key} {_shown(value)}" for key, value in values.items() if key not in geometry)
    return YamlRepair(values, done, needs_cells)


def _has_text(pair: PairFacts, key: str) -> bool:
    """Return whether a number, or one of a list, is text to YAML 1.1."""
    if key not in pair.entries:
        return False
    entry = pair.entries[key]
    return any(one.is_yaml_1_1_text for one in (entry.items() if key == "origin" else [entry]))


def _plain(value: float) -> float:
    plain = without_rounding_noise(value)
    return value if plain is None else plain


def _image_name(pair: PairFacts, wanted: Collection[str]) -> str | None:
    """Return a relative name of an image that lies in the folder of its map, or below."""
    if "yaml.image-unquoted" in wanted:
        return pair.metadata.image
    if not {"image.absolute-path", "image.foreign-path"} & set(wanted):
        return None
    folder = pair.path.parent
    if folder not in pair.image_path.parents and folder != Path():
        return None
    if pair.image_path.is_absolute() and not folder.is_absolute():
        return None
    relative = pair.image_path.relative_to(folder)
    return None if ".." in relative.parts else relative.as_posix()


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(repr(one) for one in value)
    return str(value)
