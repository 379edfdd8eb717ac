"""Times of widest ways beside distances, scikit-image and scipy, as ratios, in one process.

Run it as ``python docs/benchmarks/clearance.py [--sides 1000 4000] [--threads 1 2] [--runs 5]``;
it needs the extra ``bench``. The contenders take turns; the peers, which take 20 to 150 times as
long, on sides up to `--largest-of-peers`. Prints a table in Markdown: medians, and the median of
the pairwise ratios. Fails on nothing.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from make_map import RESOLUTION, pixels_of_map
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from skimage.graph import MCP_Flexible
from skimage.morphology import reconstruction

from mapdeal.kernels.distance import signed_distance, squared_distance
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.paths import (
    basin_areas,
    clearance_metres,
    clearance_tree,
    rooted,
    widest_metres,
)
from mapdeal.kernels.threads import use_threads

Contenders = dict[str, Callable[[], Any]]

CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])


class Minimax(MCP_Flexible):  # type: ignore[misc]
    """Paths that cost what their most expensive cell does, by steps that make up for sums."""

    so_far = 0.0

    def goal_reached(self, index: int, cumcost: float) -> int:  # noqa: ARG002
        """Note the cost of the cell whose neighbours come next."""
        self.so_far = cumcost
        return 0

    def travel_cost(
        self,
        old_cost: float,  # noqa: ARG002 - of the cell alone, not of the way to it
        new_cost: float,
        offset_length: float,  # noqa: ARG002
    ) -> float:
        """Return by how much a cell costs more than the way to it."""
        return max(new_cost - self.so_far, 0.0)


def office(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the office-like map: obstacles, and free cells; a tenth on two sides is unknown."""
    pixels = np.ascontiguousarray(pixels_of_map(side)[::-1])
    return pixels == 0, pixels == 254


def sparse(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return 1,500 obstacles of a cell in the open: basins are large, distances long."""
    occupied = np.zeros(side * side, dtype=np.bool_)
    occupied[np.random.default_rng(side).choice(side * side, 1500, replace=False)] = True
    return occupied.reshape(side, side), ~occupied.reshape(side, side)


def noise(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a map of which every twentieth cell is an obstacle: as many basins as can be."""
    occupied = np.random.default_rng(side).random((side, side)) < 0.05
    return occupied, ~occupied


MAPS = {"office": office, "1,500 obstacles": sparse, "noise of 5 %": noise}


def by_reconstruction(squared: np.ndarray, is_free: np.ndarray, start: tuple[int, int]) -> Any:
    """Return the widest ways from a start: its square, dilated below all squares."""
    mask = np.where(is_free, squared, 0)
    seed = np.zeros_like(mask)
    seed[start] = mask[start]
    return reconstruction(seed, mask, footprint=CROSS)


def by_minimax(squared: np.ndarray, is_free: np.ndarray, start: tuple[int, int]) -> Any:
    """Return the same by a search whose costs fall with squares; each step calls Python."""
    most = float(squared.max())
    costs = np.where(is_free, most - squared, -1.0)
    found, _ = Minimax(costs, fully_connected=False).find_costs([start])
    return np.where(np.isfinite(found), most - found, 0.0)


def by_spanning_tree(squared: np.ndarray, is_free: np.ndarray) -> Any:
    """Return the maximum spanning forest of all neighbouring free cells, which is not yet a way."""
    own = np.arange(squared.size, dtype=np.int32).reshape(squared.shape)
    weight = np.where(is_free, squared, 0)
    pairs = [(own[:, :-1], own[:, 1:]), (own[:-1], own[1:])]
    weights = [
        np.minimum(weight[:, :-1], weight[:, 1:]),
        np.minimum(weight[:-1], weight[1:]),
    ]
    one, other = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    lesser = np.concatenate([some.ravel() for some in weights])
    kept = lesser > 0
    costs = float(squared.max()) + 1.0 - lesser[kept]
    graph = coo_array((costs, (one[kept], other[kept])), shape=(own.size, own.size))
    return minimum_spanning_tree(graph.tocsr(), overwrite=True)


def contenders(occupied: np.ndarray, is_free: np.ndarray, *, with_peers: bool) -> Contenders:
    """Return what is measured on a map."""
    squared = squared_distance(occupied)
    start = middle_of(is_free)
    tree = clearance_tree(squared, is_free)
    seen = rooted(tree, int(tree.basins[start]))

    def whole() -> Any:
        squared = squared_distance(occupied)
        tree = clearance_tree(squared, is_free)
        seen = rooted(tree, int(tree.basins[start]))
        areas = basin_areas(tree, squared, 36)
        widest = widest_metres(tree, squared, start, RESOLUTION, seen=seen, in_place=True)
        return areas, widest, clearance_metres(squared, RESOLUTION, in_place=True)

    def from_squares() -> Any:
        return widest_metres(clearance_tree(squared, is_free), squared, start, 1.0)

    listed: Contenders = {
        "esdf": lambda: signed_distance(occupied, scale=RESOLUTION),
        "squares": lambda: squared_distance(occupied),
        "tree": lambda: clearance_tree(squared, is_free),
        "rooted": lambda: rooted(tree, int(tree.basins[start])),
        "areas": lambda: basin_areas(tree, squared, 36),
        "widest, m": lambda: widest_metres(tree, squared, start, RESOLUTION, seen=seen),
        "all of it": whole,
        "squares to widest": from_squares,
    }
    if with_peers:
        listed["reconstruction"] = lambda: by_reconstruction(squared, is_free, start)
        listed["MCP"] = lambda: by_minimax(squared, is_free, start)
        listed["spanning tree"] = lambda: by_spanning_tree(squared, is_free)
    return listed


def middle_of(is_free: np.ndarray) -> tuple[int, int]:
    """Return a free cell near the middle."""
    rows, cols = np.nonzero(is_free)
    nearest = np.argmin((rows - is_free.shape[0] // 2) ** 2 + (cols - is_free.shape[1] // 2) ** 2)
    return int(rows[nearest]), int(cols[nearest])


def check(side: int) -> None:
    """Stop unless the contenders' widest ways are the same."""
    for make in MAPS.values():
        occupied, is_free = make(side)
        squared, start = squared_distance(occupied), middle_of(is_free)
        widest = widest_metres(clearance_tree(squared, is_free), squared, start, 1.0)
        for theirs in (by_reconstruction, by_minimax):
            if not np.array_equal(np.float32(np.sqrt(theirs(squared, is_free, start))), widest):
                raise SystemExit(f"{theirs.__name__} has found other ways")


def measured(listed: Contenders, runs: int) -> dict[str, list[float]]:
    """Return the times of each contender in milliseconds, the first turn left out."""
    times: dict[str, list[float]] = {name: [] for name in listed}
    for turn in range(runs + 1):
        for name, work in listed.items():
            started = time.perf_counter()
            result = work()
            seconds = time.perf_counter() - started
            del result
            if turn > 0:
                times[name].append(1e3 * seconds)
    return times


def row_of(times: dict[str, list[float]]) -> str:
    """Return medians, that of the tree with its ratio to esdf, peers' with theirs to ours."""
    cells = []
    for name in ("esdf", "squares", "tree", "rooted", "areas", "widest, m", "all of it"):
        text = f"{statistics.median(times[name]):.0f}"
        if name == "tree":
            text += f" ({ratio(times['tree'], times['esdf']):.2g} x esdf)"
        cells.append(text)
    for name in ("reconstruction", "MCP", "spanning tree"):
        if name not in times:
            cells.append("")
            continue
        ours = times["tree" if name == "spanning tree" else "squares to widest"]
        cells.append(f"{ratio(times[name], ours):.3g} x ({statistics.median(times[name]):.0f})")
    return " | ".join(cells)


def ratio(some: list[float], others: list[float]) -> float:
    """Return the median of the pairwise ratios."""
    return statistics.median(a / b for a, b in zip(some, others, strict=True))


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", type=int, nargs="+", default=[1000, 4000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--largest-of-peers", type=int, default=1000)
    options = parser.parse_args()
    check(200)
    print(f"kernels: {engine_name()}; milliseconds\n")
    columns = "esdf | squares | tree | rooted | areas | widest, m | all of it"
    print(f"| cells a side | map | threads | {columns} | reconstruction | MCP | spanning tree |")
    print("|---" * 13 + "|")
    for side in options.sides:
        for name, make in MAPS.items():
            occupied, is_free = make(side)
            for threads in options.threads:
                with use_threads(threads):
                    peers = side <= options.largest_of_peers
                    listed = contenders(occupied, is_free, with_peers=peers)
                    times = measured(listed, options.runs)
                print(f"| {side} | {name} | {threads} | {row_of(times)} |", flush=True)


if __name__ == "__main__":
    main()
