"""The figures of each stage, for the manifest and for a line on the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.npz import AnyGrid
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.large import LargeCosts, LargeField, LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import (
    FREE,
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
    Convention,
)
from mapdeal.kernels.rows import counts_of_rows, slabs_of

Figures = dict[str, Any]

_COST_SHARES = ["lethal", "inscribed", "graded", "free", "unknown"]
_OCCUPANCY_SHARES = ["occupied", "between", "free", "unknown"]


def figures_of(grid: AnyGrid | BitMap) -> Figures:
    """Return the figures of a grid, as JSON can hold them."""
    figures = frame_figures(grid)
    if isinstance(grid, (DistanceField, LargeField)):
        obstacles = grid.obstacles()
        figures |= field_figures(
            (extent_of(grid.distance[slab], obstacles[slab]) for slab in slabs_of(grid.distance)),
            grid.convention,
        )
    elif isinstance(grid, PotentialField):
        figures |= _potential_figures(grid)
    elif isinstance(grid, (Costmap, LargeCosts)):
        figures |= _cost_figures(grid)
    elif isinstance(grid, BitMap):
        ones, cells = grid.count(), grid.shape[0] * grid.shape[1]
        figures |= {"occupied": ones, "free": cells - ones, "unknown": 0, "between": 0}
    else:
        figures |= occupancy_counts(grid)
    return figures


def occupancy_counts(grid: OccupancyGrid | LargeMap) -> Figures:
    """Return how many cells are occupied, free, unknown and in between."""
    counts = counts_of_rows(grid.occupancy)
    occupied, free = int(counts[OCCUPIED]), int(counts[FREE])
    unknown = int(counts[UNKNOWN])
    between = int(counts.sum()) - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}


def summary_of(figures: Figures) -> str:
    """Return the figures as one line for a person."""
    cells = figures["width"] * figures["height"]

    def share(name: str) -> str:
        percent = 100 * figures[name] / cells
        return f"{name} {percent:.2f} %"

    if "lowest_distance" in figures:
        least, most = figures["lowest_distance"], figures["highest_distance"]
        if least is None or most is None:
            return "no obstacle" if figures["obstacles"] == 0 else "nothing but obstacles"
        return f"{least + 0.0:.4g} .. {most:.4g} m, convention {figures['convention']}"
    if "lowest_potential" in figures:
        least, most = figures["lowest_potential"], figures["highest_potential"]
        x, y = figures["goal"] or (None, None)
        what = "no goal, repulsion" if x is None else f"goal {x:.10g}, {y:.10g}, potential"
        return f"{what} {least:.5g} .. {most:.5g}"
    if "lethal" in figures:
        names = [name for name in _COST_SHARES if name in figures]
        text = ", ".join(share(name) for name in names)
        if figures.get("circumscribed_cost") is not None:
            text += f", circumscribed_cost {figures['circumscribed_cost']}"
        return text
    names = [name for name in _OCCUPANCY_SHARES if figures[name] or name != "between"]
    return ", ".join(share(name) for name in names)


def frame_figures(grid: AnyGrid | BitMap) -> Figures:
    """Return the figures that all grids have."""
    return {
        "width": grid.shape[1],
        "height": grid.shape[0],
        "resolution": grid.resolution,
        "origin": list(grid.origin),
    }


@dataclass(frozen=True)
class Extent:
    """How far some distances reach, and of how many obstacle cells."""

    lowest: float
    highest: float
    obstacles: int


def extent_of(distance: NDArray[np.float32], obstacles: NDArray[np.bool_]) -> Extent:
    """Return how far the distances of a field, or of some of its rows, reach."""
    return Extent(
        float(distance.min()), float(distance.max()), int(np.count_nonzero(obstacles))
    )  # fmt: skip


def field_figures(parts: Iterable[Extent], convention: Convention) -> Figures:
    """Return the figures of a field, given all its parts."""
    obstacles, lowest, highest = 0, math.inf, -math.inf
    for part in parts:
        obstacles += part.obstacles
        lowest, highest = min(lowest, part.lowest), max(highest, part.highest)
    finite = math.isfinite(lowest) and math.isfinite(highest)
    return {
        "convention": convention,
        "obstacles": obstacles,
        "lowest_distance": lowest if finite else None,
        "highest_distance": highest if finite else None,
    }


def _potential_figures(field: PotentialField) -> Figures:
    return {
        "goal": None if field.goal is None else list(field.goal),
        "obstacles": int(np.count_nonzero(field.obstacles())),
        "lowest_potential": float(field.potential.min()),
        "highest_potential": float(field.potential.max()),
    }


def _cost_figures(costmap: Costmap | LargeCosts) -> Figures:
    counts = counts_of_rows(costmap.cost)
    figures: Figures = {"cost_scale": costmap.scale, "free": int(counts[0])}
    if costmap.scale == "costmap2d":
        figures["lethal"] = int(counts[LETHAL_OBSTACLE])
        figures["inscribed"] = int(counts[INSCRIBED_INFLATED_OBSTACLE])
        figures["unknown"] = int(counts[NO_INFORMATION])
        figures["circumscribed_cost"] = costmap.circumscribed_cost
    else:
        figures["lethal"] = int(counts[OCCUPIED])
        figures["unknown"] = int(counts[UNKNOWN])
    named = sum(figures.get(name, 0) for name in _COST_SHARES)
    figures["graded"] = int(counts.sum()) - named
    return figures
