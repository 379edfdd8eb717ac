"""Times of widest paths beside distances, scikit-image and scipy, in one process.

Run it as ``python docs/benchmarks/clearance.py [--sides 1000 4000] [--runs 5]``, one thread. The
peers take part on maps of at most 1000 cells a side.
"""

from typing import Any

import numpy as np
from make_map import MAPS, RESOLUTION
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from skimage.morphology import reconstruction
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal.kernels import paths
from mapdeal.kernels.distance import signed_distance, squared_distance
from mapdeal.kernels.threads import use_threads

LARGEST_OF_PEERS = 1000
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])


def by_reconstruction(squared: np.ndarray, is_free: np.ndarray, start: Any) -> np.ndarray:
    """Return the widest ways from a start: its square, dilated below all squares."""
    mask = np.where(is_free, squared, 0)
    seed = np.zeros_like(mask)
    seed[start] = mask[start]
    return reconstruction(seed, mask, footprint=CROSS)


def by_spanning_tree(squared: np.ndarray, is_free: np.ndarray) -> object:
    """Return the maximum spanning forest of all neighbouring free cells, which is not yet a way."""
    own = np.arange(squared.size, dtype=np.int32).reshape(squared.shape)
    weight = np.where(is_free, squared, 0)
    steps = [(np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])]
    one, other = (np.concatenate([own[step[k]].ravel() for step in steps]) for k in (0, 1))
    lesser = np.concatenate([np.minimum(weight[a], weight[b]).ravel() for a, b in steps])
    kept = lesser > 0
    costs = float(squared.max()) + 1.0 - lesser[kept]
    graph = coo_array((costs, (one[kept], other[kept])), shape=(own.size, own.size))
    return minimum_spanning_tree(graph.tocsr(), overwrite=True)


def contenders(pixels: np.ndarray) -> dict[str, Contender]:
    """Return what is measured on a map, for paths from a free cell near its middle."""
    occupied, is_free = pixels == 0, pixels == 254
    free_cells = np.argwhere(is_free)
    from_middle = np.abs(free_cells - len(pixels) // 2).sum(axis=1)
    start = tuple(free_cells[from_middle.argmin()].tolist())
    squared = squared_distance(occupied)

    def tree_and_widths() -> np.ndarray:
        tree = paths.clearance_tree(squared, is_free)
        rooted = paths.rooted(tree, int(tree.basins[start]))
        return paths.widest_metres(tree, rooted, squared, start, 1.0)

    def all_of_it() -> object:
        squared = squared_distance(occupied)
        tree = paths.clearance_tree(squared, is_free)
        rooted = paths.rooted(tree, int(tree.basins[start]))
        areas = paths.basin_areas(tree, squared, 36)
        widest = paths.widest_metres(tree, rooted, squared, start, RESOLUTION, in_place=True)
        return areas, widest, paths.clearance_metres(squared, RESOLUTION, in_place=True)

    listed: dict[str, Contender] = {
        "signed field": lambda: signed_distance(occupied, scale=RESOLUTION),
        "tree": lambda: paths.clearance_tree(squared, is_free),
        "all of it": all_of_it,
    }
    if len(pixels) <= LARGEST_OF_PEERS:
        theirs = np.sqrt(by_reconstruction(squared, is_free, start))
        assert np.array_equal(np.float32(theirs), tree_and_widths())
        listed |= {
            "tree and widths": tree_and_widths,
            "reconstruction": lambda: by_reconstruction(squared, is_free, start),
            "spanning tree": lambda: by_spanning_tree(squared, is_free),
        }
    return listed


if __name__ == "__main__":
    given = options(__doc__, sides=[1000, 4000], runs=5)
    head("cells a side", "map", "signed field, ms", "tree, ms", "all of it, ms",
         "reconstruction to tree and widths", "spanning tree to tree")  # fmt: skip
    for side in given.sides:
        for name, make in MAPS.items():
            listed = contenders(np.ascontiguousarray(make(side)[::-1]))
            with use_threads(1):
                times = in_turns(listed, given.runs)
            ours = [times[one].ms for one in ("signed field", "tree", "all of it")]
            pairs = {"reconstruction": "tree and widths", "spanning tree": "tree"}
            peers = [ratio(times[a], times[b]) for a, b in pairs.items() if a in times]
            row(side, name, *ours, *(peers or ["", ""]))
