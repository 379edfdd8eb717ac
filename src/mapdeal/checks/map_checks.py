"""Checks of a map's cells."""

from __future__ import annotations

from collections.abc import Iterator

from mapdeal.checks.check import check
from mapdeal.checks.facts import GridFacts
from mapdeal.checks.finding import Remark
from mapdeal.formats.map_remarks import NOTHING_KNOWN

_MIN_ISLAND_AREA = 1.0
"""Square metres at or above which a component of free space is an island, not a speck."""


@check("map.no-obstacle", "warning", "a map without any obstacle")
def no_obstacle(facts: GridFacts) -> Iterator[str]:
    """Look for obstacles: without one the distance field is infinite everywhere."""
    if not facts.counts["occupied"] and facts.counts["unknown"] < facts.cells.size:
        yield "no cell is occupied; are the thresholds and negate right?"


@check("map.no-free", "warning", "a map without any free cell")
def no_free(facts: GridFacts) -> Iterator[str]:
    """Look for free cells: without one there is no place for a robot."""
    if not facts.counts["free"] and facts.counts["unknown"] < facts.cells.size:
        yield "no cell is free; are the thresholds and negate right?"


@check("map.all-unknown", "error", "a map of which nothing is known")
def all_unknown(facts: GridFacts) -> Iterator[str]:
    """Look for known cells: without one the map is of no use."""
    if facts.counts["unknown"] == facts.cells.size:
        yield NOTHING_KNOWN


@check("map.mostly-unknown", "note", "a small known part on a large unknown canvas")
def mostly_unknown(facts: GridFacts) -> Iterator[Remark]:
    """Compare the bounding box of known cells with the map: gmapping saves much unknown space."""
    height, width = facts.cells.known_box
    share = height * width / facts.cells.size
    if 0 < share < 0.5:
        text = f"all that is known lies in {width} x {height} cells, {100 * share:.0f} %"
        middle = facts.places([facts.cells.middle_of_known])
        yield Remark(f"{text}: try mapdeal active", places=middle)


@check("map.inside-out", "warning", "more occupied than free cells")
def inside_out(facts: GridFacts) -> Iterator[str]:
    """Compare their numbers; often negate is wrong."""
    occupied, free = facts.counts["occupied"], facts.counts["free"]
    if occupied > free > 0:
        yield f"{occupied} cells are occupied and {free} free; is negate right?"


@check("map.islands", "warning", "free space that cannot be reached from the largest part")
def islands(facts: GridFacts) -> Iterator[Remark]:
    """Measure the connected components of a square metre or more."""
    sizes, counts = facts.other_components
    is_large = sizes * _cell_area(facts) >= _MIN_ISLAND_AREA
    count = int(counts[is_large].sum())
    if count:
        area = float((sizes * counts)[is_large].sum()) * _cell_area(facts)
        largest = facts.cells.free_components[0][-1] * _cell_area(facts)
        parts = "area" if count == 1 else "areas"
        text = (
            f"{count} {parts} of free space, {area:.3g} m2, cannot be reached from"
            f" the largest, {largest:.4g} m2"
        )
        least = int(sizes[is_large][0])
        cells = facts.cells.places_of_components(least, facts.cells.size)
        yield Remark(text, places=facts.places(cells))


@check("map.specks", "note", "small patches of free space apart from the rest")
def specks(facts: GridFacts) -> Iterator[Remark]:
    """Count the smaller components: stray beams, mostly."""
    sizes, counts = facts.other_components
    is_small = sizes * _cell_area(facts) < _MIN_ISLAND_AREA
    count = int(counts[is_small].sum())
    if count:
        cells = int((sizes * counts)[is_small].sum())
        text = f"{count} patches of free space are smaller than 1 m2, {cells} cells"
        places = facts.cells.places_of_components(1, int(sizes[is_small][-1]))
        yield Remark(text, places=facts.places(places))


@check("map.open-border", "note", "free cells on the border of the map")
def open_border(facts: GridFacts) -> Iterator[Remark]:
    """Count them: free space seems to go on, but nothing is known beyond."""
    count = facts.cells.free_on_border
    if count:
        text = f"{count} of {facts.cells.border} cells on the border are free; is the map cut off?"
        yield Remark(text, places=facts.places(facts.cells.free_stretches))


def _cell_area(facts: GridFacts) -> float:
    """Return the square metres of a cell."""
    return facts.frame.resolution**2
