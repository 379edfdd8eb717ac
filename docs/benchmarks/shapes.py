"""Times of inflation and rings beside OpenCV's dilations, in one process.

Run it as ``python docs/benchmarks/shapes.py [--sides 2000 4000] [--threads 1 2] [--runs 9]``.
mapdeal makes a map of a map, with all that the stage does; OpenCV a mask of a mask, which numpy
then puts into a copy of the map.
"""

from argparse import Namespace
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from make_map import MAPS, RESOLUTION, cells_of_map, grid_of
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal import OccupancyGrid, inflate, ring_cost
from mapdeal.kernels.threads import use_threads

REACHES = (1, 3, 6, 10, 20)
RINGS = (90, 70, 50)
SQUARE = np.ones((3, 3), np.uint8)

Pair = tuple[Contender, Contender]


def inflations(grid: OccupancyGrid, shape: str, reach: int) -> Pair:
    y, x = np.ogrid[-reach : reach + 1, -reach : reach + 1]
    limit = reach * reach if shape == "disc" else 2 * reach * reach
    kernel = (y * y + x * x <= limit).astype(np.uint8)

    def opencv() -> np.ndarray:
        grown = cv2.dilate((grid.occupancy >= 100).view(np.uint8), kernel)
        inflated = grid.occupancy.copy()
        inflated[grown > 0] = 100
        return inflated

    def mapdeal() -> np.ndarray:
        return inflate(grid, radius=reach * RESOLUTION, kernel=shape).occupancy  # type: ignore[arg-type]

    assert np.array_equal(mapdeal(), opencv())
    return mapdeal, opencv


def rings(grid: OccupancyGrid) -> Pair:
    def opencv() -> np.ndarray:
        inner = (grid.occupancy >= 100).view(np.uint8)
        costs = grid.occupancy.copy()
        for value in RINGS:
            outer = cv2.dilate(inner, SQUARE)
            costs[outer > inner] = value
            inner = outer
        return costs

    assert np.array_equal(ring_cost(grid, values=RINGS).cost, opencv())
    return lambda: ring_cost(grid, values=RINGS).cost, opencv


def works_of(grid: OccupancyGrid) -> dict[str, Pair]:
    shapes = [(shape, reach) for shape in ("square", "disc") for reach in REACHES]
    return {"rings, 3": rings(grid)} | {f"{a}, {b}": inflations(grid, a, b) for a, b in shapes}


def compare(maps: Iterable[tuple[int, str]], works_of: Any, given: Namespace) -> None:
    """Print a row for each piece of work on each map of a side and name."""
    head("cells a side", "map", "work", "threads", "mapdeal, ms", "peer, ms", "ratio")
    for side, name in maps:
        works = works_of(grid_of(cells_of_map(side, name)))
        for threads in given.threads:
            cv2.setNumThreads(threads)
            for work, (mapdeal, peer) in works.items():
                with use_threads(threads):
                    times = in_turns({"mapdeal": mapdeal, "peer": peer}, given.runs)
                ours, theirs = times.values()
                row(side, name, work, threads, ours.ms, theirs.ms, ratio(ours, theirs))


if __name__ == "__main__":
    given = options(__doc__, sides=[2000, 4000], threads=[1, 2], runs=9)
    maps = [(n, name) for n in given.sides for name in MAPS if n <= 2000 or name != "sparse"]
    compare(maps, works_of, given)
