"""Times of inflation and rings beside OpenCV's dilations, as ratios, in one process.

Run it as ``python docs/benchmarks/shapes.py [--sides 2000 4000] [--threads 1 2] [--runs 9]``; it
needs the extra ``bench``. Contenders take turns, each with a fresh result. mapdeal makes a map of a
map, with all that the stage does; OpenCV a mask of a mask, which numpy then puts into a copy of the
map. Prints a table in Markdown: medians in milliseconds, and the median of the pairwise ratios.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION, cells_of_map

from mapdeal import OccupancyGrid, inflate, ring_cost
from mapdeal.kernels.threads import use_threads

REACHES = (1, 3, 6, 10, 20)
RINGS = (90, 70, 50)
SPARSE_SIDE, SPARSE_OBSTACLES, NOISE = 1984, 1500, 0.05

Contender = Callable[[], Any]


def maps(side: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and obstacles: an office, few obstacles, and noise."""
    rng = np.random.default_rng(5)
    yield f"office {side}", cells_of_map(side)
    if side == 2000:
        sparse = np.zeros((SPARSE_SIDE, SPARSE_SIDE), np.bool_)
        sparse.flat[rng.choice(sparse.size, SPARSE_OBSTACLES, replace=False)] = True
        yield f"sparse {SPARSE_SIDE}", sparse
    yield f"noise {side}", rng.random((side, side)) < NOISE


def kernel_of(shape: str, reach: int) -> np.ndarray:
    if shape == "square":
        return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    y, x = np.ogrid[-reach : reach + 1, -reach : reach + 1]
    return (y * y + x * x <= reach * reach).astype(np.uint8)


def inflations(occupied: np.ndarray, shape: str, reach: int) -> tuple[Contender, Contender]:
    values = np.where(occupied, 100, 0).astype(np.int8)
    grid = OccupancyGrid(values, RESOLUTION)
    kernel = kernel_of(shape, reach)

    def opencv() -> np.ndarray:
        grown = cv2.dilate((values >= 100).view(np.uint8), kernel)
        inflated = values.copy()
        inflated[grown > 0] = 100
        return inflated

    def mapdeal() -> np.ndarray:
        return inflate(grid, radius=reach * RESOLUTION, kernel=shape).occupancy  # type: ignore[arg-type]

    return mapdeal, opencv


def rings(occupied: np.ndarray) -> tuple[Contender, Contender]:
    values = np.where(occupied, 100, 0).astype(np.int8)
    grid = OccupancyGrid(values, RESOLUTION)
    kernel = np.ones((3, 3), np.uint8)

    def opencv() -> np.ndarray:
        inner = (values >= 100).view(np.uint8)
        costs = values.copy()
        for value in RINGS:
            outer = cv2.dilate(inner, kernel)
            costs[outer > inner] = value
            inner = outer
        return costs

    return lambda: ring_cost(grid, values=RINGS).cost, opencv


def timed(contender: Contender) -> float:
    started = time.perf_counter()
    contender()
    return time.perf_counter() - started


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    words.add_argument("--sides", type=int, nargs="+", default=[2000, 4000])
    words.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    words.add_argument("--runs", type=int, default=9)
    given = words.parse_args()
    print("| map | work | threads | mapdeal, ms | OpenCV, ms | ratio |\n|---|---|---|---|---|---|")
    for side in given.sides:
        for name, occupied in maps(side):
            works = {"rings, 3": rings(occupied)}
            for shape in ("square", "disc"):
                for reach in REACHES:
                    works[f"{shape}, {reach}"] = inflations(occupied, shape, reach)
            for threads in given.threads:
                cv2.setNumThreads(threads)
                for work, (ours, theirs) in works.items():
                    with use_threads(threads):
                        assert np.array_equal(ours(), theirs())
                        pairs = [(timed(ours), timed(theirs)) for _ in range(given.runs)]
                    mine, other = (statistics.median(one) * 1e3 for one in zip(*pairs, strict=True))
                    ratio = statistics.median(a / b for a, b in pairs)
                    print(
                        f"| {name} | {work} | {threads} | {mine:.2f} | {other:.2f} | {ratio:.2f} |"
                    )


if __name__ == "__main__":
    main()
