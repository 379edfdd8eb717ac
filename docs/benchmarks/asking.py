"""Times of queries, footprints, potentials and routes beside scipy, OpenCV and scikit-image.

Run it as ``python docs/benchmarks/asking.py [--runs 5] [--side 2000]``; potentials are on half as
many cells a side, and in two threads; the others in one.
"""

from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION, cells_of_map, grid_of
from query_by_pandas import interpolated, places_of
from skimage.graph import route_through_array
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal import Footprint, esdf, exponential_cost, footprint_costs
from mapdeal.kernels.lookup import sum_of_inverse_distances
from mapdeal.kernels.paths import cheapest_path
from mapdeal.kernels.threads import use_threads

POINTS, POSES = 2_000_000, 100_000
ROBOT = ((0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225))
NAV2 = {"inscribed_radius": 0.22, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}

Pair = tuple[Contender, Contender]


def query(side: int) -> Pair:
    """Ask a field for distances and gradients at random points."""
    field = esdf(grid_of(cells_of_map(side), (1.0, -2.0, 0.4)))
    places = np.random.default_rng(0).uniform(1, side - 1, (POINTS, 2))
    points = field.frame.xy_from_continuous_rowcol(places)

    def by_scipy() -> Any:
        places = places_of(points, field.origin, field.resolution)
        return interpolated(field.distance, places)

    assert np.allclose(field.query(points).distance, by_scipy()[0], atol=1e-4)
    return lambda: field.query(points), by_scipy


def footprints(side: int, rule: str) -> Pair:
    """Find the largest cost below a robot of 0.9 m x 0.45 m at random poses."""
    costmap = exponential_cost(grid_of(cells_of_map(side)), **NAV2)
    far = side * RESOLUTION - 1
    poses = np.random.default_rng(0).uniform((1, 1, -3.2), (far, far, 3.2), (POSES, 3))

    def ours() -> np.ndarray:
        return footprint_costs(costmap, Footprint(ROBOT), poses, rule=rule)  # type: ignore[arg-type]

    def theirs() -> np.ndarray:
        return by_opencv(costmap.cost, poses, filled=rule == "full")

    assert (ours() == theirs()).mean() > 0.95  # OpenCV draws other outlines
    return ours, theirs


def by_opencv(costs: np.ndarray, poses: np.ndarray, *, filled: bool) -> np.ndarray:
    """Return the largest cost of the cells that OpenCV draws, pose by pose, without any check."""
    corners = np.array(ROBOT)
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x = poses[:, :1] + corners[:, 0] * cos - corners[:, 1] * sin
    y = poses[:, 1:2] + corners[:, 0] * sin + corners[:, 1] * cos
    cells = (np.stack([x, y], axis=2) / RESOLUTION).astype(np.int32)
    lows, highs = cells.min(axis=1), cells.max(axis=1) + 1
    result = np.empty(len(poses), dtype=np.uint8)
    for index, ((left, low), (right, high)) in enumerate(zip(lows, highs, strict=True)):
        window = costs[low:high, left:right]
        mask = np.zeros(window.shape, dtype=np.uint8)
        outline = [cells[index] - lows[index]]
        if filled:
            cv2.fillPoly(mask, outline, 1)
        else:
            cv2.polylines(mask, outline, isClosed=True, color=1)
        result[index] = cv2.minMaxLoc(window, mask)[1]
    return result


def potentials(side: int) -> Pair:
    """Sum 1 / distance over all obstacles, by convolution and term by term."""
    occupied = cells_of_map(side)
    offsets = np.arange(-side + 1, side)

    def direct() -> np.ndarray:
        with np.errstate(divide="ignore"):
            table = 1 / (RESOLUTION * np.hypot(offsets[:, np.newaxis], offsets))
        table[side - 1, side - 1] = 0.0
        total = np.zeros(occupied.shape)
        for top, left in (side - 1 - np.argwhere(occupied)).tolist():
            total += table[top : top + side, left : left + side]
        return total

    assert np.allclose(sum_of_inverse_distances(occupied, scale=RESOLUTION), direct())
    return lambda: sum_of_inverse_distances(occupied, scale=RESOLUTION), direct


def route(side: int) -> Pair:
    cost = exponential_cost(grid_of(cells_of_map(side)), **NAV2).cost
    by_cost = np.zeros(256)
    by_cost[:253] = 1 + 2 * np.arange(253) / 252
    weights = by_cost[cost]
    open_cells = np.argwhere(weights > 0)
    sums = open_cells.sum(axis=1)
    start, goal = (tuple(open_cells[k].tolist()) for k in (sums.argmin(), sums.argmax()))
    negative = np.where(weights > 0, weights, -1.0)

    def by_skimage() -> Any:
        return route_through_array(negative, start, goal, geometric=True)

    # theirs goes between touching corners
    assert np.isclose(cheapest_path(weights, start, goal).cost, by_skimage()[1], rtol=0.01)
    return lambda: cheapest_path(weights, start, goal), by_skimage


if __name__ == "__main__":
    given = options(__doc__, runs=5, side=2000)
    works = {
        f"distance and gradient at {POINTS} points; scipy": (1, query(given.side)),
        f"cost at {POSES} poses, outline; OpenCV": (1, footprints(given.side, "outline")),
        "the same with the inside; OpenCV": (1, footprints(given.side, "full")),
        "repulsion; sum over all obstacles": (2, potentials(given.side // 2)),
        "route from corner to corner; scikit-image": (1, route(given.side)),
    }
    head("work; peer", "mapdeal, ms", "peer, ms", "ratio")
    for work, (threads, (mapdeal, peer)) in works.items():
        with use_threads(threads):
            ours, theirs = in_turns({"mapdeal": mapdeal, "peer": peer}, given.runs).values()
        row(work, ours.ms, theirs.ms, ratio(ours, theirs))
