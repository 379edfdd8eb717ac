"""Checks of a map's cells."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mapdeal.checks.check import check
from mapdeal.checks.facts import GridFacts

_MIN_ISLAND_AREA = 1.0
"""Square metres at or above which a component of free space is an island, not a speck."""


@check("map.no-obstacle", "warning", "a map without any obstacle")
def no_obstacle(facts: GridFacts) -> Iterator[str]:
    """Look for obstacles: without one the distance field is infinite everywhere."""
    if not facts.counts["occupied"] and facts.counts["unknown"] < facts.grid.occupancy.size:
        yield "no cell is occupied; are the thresholds and negate right?"


@check("map.no-free", "warning", "a map without any free cell")
def no_free(facts: GridFacts) -> Iterator[str]:
    """Look for free cells: without one there is no place for a robot."""
    if not facts.counts["free"] and facts.counts["unknown"] < facts.grid.occupancy.size:
        yield "no cell is free; are the thresholds and negate right?"


@check("map.all-unknown", "error", "a map of which nothing is known")
def all_unknown(facts: GridFacts) -> Iterator[str]:
    """Look for known cells: without one the map is of no use."""
    if facts.counts["unknown"] == facts.grid.occupancy.size:
        yield "every cell is unknown"


@check("map.mostly-unknown", "note", "a small known part on a large unknown canvas")
def mostly_unknown(facts: GridFacts) -> Iterator[str]:
    """Compare the bounding box of known cells with the map: gmapping saves much unknown space."""
    known = facts.grid.occupancy >= 0
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not rows.size:
        return
    height, width = int(np.ptp(rows)) + 1, int(np.ptp(cols)) + 1
    if height * width < known.size / 2:
        share = 100 * height * width / known.size
        text = f"all that is known lies in {width} x {height} cells, {share:.0f} %"
        yield f"{text}: try mapdeal active"


@check("map.inside-out", "warning", "more occupied than free cells")
def inside_out(facts: GridFacts) -> Iterator[str]:
    """Compare their numbers; often negate is wrong."""
    occupied, free = facts.counts["occupied"], facts.counts["free"]
    if occupied > free > 0:
        yield f"{occupied} cells are occupied and {free} free; is negate right?"


@check("map.islands", "warning", "free space that cannot be reached from the largest part")
def islands(facts: GridFacts) -> Iterator[str]:
    """Measure the connected components of a square metre or more."""
    areas = _component_sizes(facts) * facts.grid.resolution**2
    large = areas[1:][areas[1:] >= _MIN_ISLAND_AREA]
    if large.size:
        parts = "area" if large.size == 1 else "areas"
        yield (
            f"{large.size} {parts} of free space, {large.sum():.3g} m2, cannot be reached from"
            f" the largest, {areas[0]:.4g} m2"
        )


@check("map.specks", "note", "small patches of free space apart from the rest")
def specks(facts: GridFacts) -> Iterator[str]:
    """Count the smaller components: stray beams, mostly."""
    cells = _component_sizes(facts)
    small = cells[1:][cells[1:] * facts.grid.resolution**2 < _MIN_ISLAND_AREA]
    if small.size:
        yield f"{small.size} patches of free space are smaller than 1 m2, {small.sum()} cells"


@check("map.open-border", "note", "free cells on the border of the map")
def open_border(facts: GridFacts) -> Iterator[str]:
    """Count them: free space seems to go on, but nothing is known beyond."""
    free = facts.grid.occupancy == 0
    edges = np.concatenate([free[0], free[-1], free[1:-1, 0], free[1:-1, -1]])
    count = int(np.count_nonzero(edges))
    if count:
        yield f"{count} of {edges.size} cells on the border are free; is the map cut off?"


def _component_sizes(facts: GridFacts) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the cells of each component of free space, 8-connected, the largest first."""
    from scipy import ndimage

    labels, count = ndimage.label(facts.grid.occupancy == 0, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.reshape(-1), minlength=count + 1)[1:]
    return np.sort(sizes)[::-1].astype(np.int64)
