"""Times of queries, footprints, potentials and routes beside scipy, OpenCV and scikit-image.

Run it as ``python docs/benchmarks/asking.py [--runs 5]``; it needs the extra ``bench``. The
contenders take turns in one process. Prints tables in Markdown: medians, and the median of the
pairwise ratios. Fails on nothing.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION, cells_of_map
from scipy import ndimage
from skimage.graph import route_through_array

from mapdeal import (
    Costmap,
    DistanceField,
    Footprint,
    OccupancyGrid,
    esdf,
    exponential_cost,
    footprint_costs,
)
from mapdeal.kernels.engine import VARIABLE, engine_name
from mapdeal.kernels.lookup import sum_of_inverse_distances
from mapdeal.kernels.paths import cheapest_path
from mapdeal.kernels.threads import use_threads

POINTS = 2_000_000
POSES = 100_000
ROBOT = ((0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225))
NAV2 = {"inscribed_radius": 0.22, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}

Contenders = dict[str, Callable[[], Any]]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    print(f"kernels: {engine_name()}\n")
    queries(runs)
    footprints(runs)
    potentials(runs)
    routes(runs)


def queries(runs: int) -> None:
    """Ask a field of 2000 x 2000 cells at random points, one thread."""
    occupied = cells_of_map(2000)
    field = esdf(OccupancyGrid(occupied.astype(np.int8) * 100, RESOLUTION, (1.0, -2.0, 0.4)))
    rng = np.random.default_rng(0)
    points = field.frame.xy_from_continuous_rowcol(rng.uniform(0, 2000, (POINTS, 2)))

    def asked() -> Any:
        with use_threads(1):
            return field.query(points)

    def interpolated() -> Any:
        return _by_scipy(field, points)

    print(f"query, {POINTS} points, one thread")
    _table({"mapdeal": asked, "numpy twin": _on_twin(asked), "scipy": interpolated}, runs,
           unit=POINTS)  # fmt: skip


def _by_scipy(field: DistanceField, points: np.ndarray) -> Any:
    """Return distance and gradient by linear interpolation, without any check."""
    x, y, yaw = field.origin
    cos, sin = np.cos(yaw), np.sin(yaw)
    moved = points - (x, y)
    places = (moved @ np.array([[-sin, cos], [cos, sin]])).T / field.resolution - 0.5
    distance = ndimage.map_coordinates(field.distance, places, order=1, mode="nearest")
    slopes = []
    for axis in (0, 1):
        ahead = places.copy()
        ahead[axis] += 0.5
        behind = places.copy()
        behind[axis] -= 0.5
        slopes.append(
            ndimage.map_coordinates(field.distance, ahead, order=1, mode="nearest")
            - ndimage.map_coordinates(field.distance, behind, order=1, mode="nearest")
        )
    return distance, slopes


def footprints(runs: int) -> None:
    """Check a robot of 0.9 m x 0.45 m at random poses, one thread."""
    occupied = cells_of_map(2000)
    costmap = exponential_cost(OccupancyGrid(occupied.astype(np.int8) * 100, RESOLUTION), **NAV2)
    rng = np.random.default_rng(0)
    poses = rng.uniform((1, 1, -3.2), (99, 99, 3.2), (POSES, 3))
    for rule in ("outline", "full"):
        _footprints(costmap, poses, rule, runs)


def _footprints(costmap: Costmap, poses: np.ndarray, rule: Any, runs: int) -> None:
    robot = Footprint(ROBOT)

    def checked() -> Any:
        with use_threads(1):
            return footprint_costs(costmap, robot, poses, rule=rule)

    def drawn() -> Any:
        return _by_opencv(costmap.cost, poses, filled=rule == "full")

    same = float((checked() == drawn()).mean())
    print(f"footprints, {rule}, {POSES} poses, one thread; OpenCV has {100 * same:.2f} % alike")
    _table({"mapdeal": checked, "numpy twin": _on_twin(checked), "OpenCV": drawn}, runs, unit=POSES)


def _by_opencv(costs: np.ndarray, poses: np.ndarray, *, filled: bool) -> np.ndarray:
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


def potentials(runs: int) -> None:
    """Sum 1 / distance over all obstacles, by convolution and term by term."""
    for side in (300, 1000):
        occupied = cells_of_map(side)
        print(f"repulsion, {side} x {side} cells, {int(occupied.sum())} obstacle cells")
        kept: dict[str, Any] = {}

        def direct(occupied: np.ndarray = occupied, kept: dict[str, Any] = kept) -> None:
            kept["direct"] = _direct_sum(occupied)

        def convolved(occupied: np.ndarray = occupied, kept: dict[str, Any] = kept) -> None:
            kept["fft"] = sum_of_inverse_distances(occupied, scale=RESOLUTION)

        _table({"mapdeal": convolved, "direct sum": direct}, min(runs, 3) if side > 300 else runs)
        worst = np.max(np.abs(kept["fft"] - kept["direct"]) / kept["direct"])
        print(f"largest relative difference {worst:.1e}\n")


def _direct_sum(occupied: np.ndarray) -> np.ndarray:
    """Add the terms of one obstacle after the other, from a table of all of them."""
    height, width = occupied.shape
    rows = np.arange(-height + 1, height)[:, np.newaxis]
    with np.errstate(divide="ignore"):
        table = 1 / (RESOLUTION * np.hypot(rows, np.arange(-width + 1, width)))
    table[height - 1, width - 1] = 0.0
    total = np.zeros(occupied.shape)
    for row, col in np.argwhere(occupied).tolist():
        total += table[
            height - 1 - row : 2 * height - 1 - row, width - 1 - col : 2 * width - 1 - col
        ]
    return total


def routes(runs: int) -> None:
    """Go from corner to corner of 2000 x 2000 cells."""
    occupied = cells_of_map(2000)
    grid = OccupancyGrid(occupied.astype(np.int8) * 100, RESOLUTION)
    cost = exponential_cost(grid, **NAV2).cost
    by_cost = np.zeros(256)
    by_cost[:253] = 1 + 2 * np.arange(253) / 252
    weights = by_cost[cost]
    open_cells = np.argwhere(weights > 0)
    sums = open_cells.sum(axis=1)
    start, goal = (tuple(open_cells[k].tolist()) for k in (sums.argmin(), sums.argmax()))
    negative = np.where(weights > 0, weights, -1.0)

    def found() -> Any:
        return cheapest_path(weights, start, goal)

    def by_skimage() -> Any:
        return route_through_array(negative, start, goal, geometric=True)

    print(f"route, 2000 x 2000 cells, {len(found().cells)} cells long")
    _table({"mapdeal": found, "Python twin": _on_twin(found), "scikit-image": by_skimage}, runs)


def _on_twin(work: Callable[[], Any]) -> Callable[[], Any]:
    """Return `work` on the engine that serves where there is no compiler."""

    def twin() -> Any:
        old = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = "scipy"
        try:
            return work()
        finally:
            if old is None:
                del os.environ[VARIABLE]
            else:
                os.environ[VARIABLE] = old

    return twin


def _table(contenders: Contenders, runs: int, unit: int | None = None) -> None:
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(runs + 1):
        for name, work in contenders.items():
            start = time.perf_counter()
            work()
            if turn:  # the first is a warm-up
                times[name].append(time.perf_counter() - start)
    ours = times["mapdeal"]
    head = "| contender | seconds | mapdeal to it |"
    print(head + (" million a second |" if unit else ""))
    print("|---|---|---|" + ("---|" if unit else ""))
    for name, seconds in times.items():
        median = statistics.median(seconds)
        ratio = statistics.median(a / b for a, b in zip(ours, seconds, strict=True))
        rate = f" {unit / median / 1e6:.1f} |" if unit else ""
        print(f"| {name} | {median:.3g} | {ratio:.3g} |{rate}")
    print()


if __name__ == "__main__":
    main()
