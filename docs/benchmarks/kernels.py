"""Times of the distance kernels beside OpenCV, edt and scipy, as ratios, in one process.

Run it as ``python docs/benchmarks/kernels.py [--sides 500 2000 4000 8000] [--threads 1 2]
[--runs 5]``; it needs the extra ``bench``. The contenders take turns, A B C A B C, each with a
fresh result, so that a drift of the machine's speed falls on all of them. Prints a table in
Markdown: medians, and the median of the pairwise ratios. Fails on nothing.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import edt as edt_package
import numpy as np
from make_map import RESOLUTION, cells_of_map
from scipy import ndimage

from mapdeal.grid.costmap import InflationLayer
from mapdeal.kernels.distance import (
    bytes_by_distance,
    signed_distance,
    squared_distance,
    within_distance,
)
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import use_threads
from mapdeal.stages.exponential_cost import cost_table

DISC_CELLS = 6
REACH_CELLS = 35
INSCRIBED, FACTOR = 0.3, 3.0

COLUMNS = ("OpenCV", "OpenCV dilate", "edt", "scipy", "plain copy")

Contenders = dict[str, Callable[[], Any]]


def signed(occupied: np.ndarray, threads: int) -> Contenders:
    """Return what makes a signed field in metres, float32."""
    cells = occupied.view(np.uint8)

    def opencv() -> Any:
        outside = cv2.distanceTransform(1 - cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside = cv2.distanceTransform(cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        field = cv2.subtract(outside, inside)
        return cv2.multiply(field, RESOLUTION, dst=field)

    def scipy() -> Any:
        outside = ndimage.distance_transform_edt(~occupied)
        inside = ndimage.distance_transform_edt(occupied)
        return ((outside - inside) * RESOLUTION).astype(np.float32)

    return {
        "mapdeal": lambda: signed_distance(occupied, scale=RESOLUTION),
        "OpenCV": opencv,
        "edt": lambda: (
            -edt_package.sdf(occupied, anisotropy=(RESOLUTION, RESOLUTION), parallel=threads)
        ),
        "scipy": scipy,
    }


def unsigned(occupied: np.ndarray, threads: int) -> Contenders:
    """Return what makes distances to the nearest obstacle."""
    free = 1 - occupied.view(np.uint8)
    return {
        "mapdeal": lambda: squared_distance(occupied),
        "OpenCV": lambda: cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE),
        "edt": lambda: edt_package.edtsq(free, parallel=threads),
        "scipy": lambda: ndimage.distance_transform_edt(free),
    }


def truncated(occupied: np.ndarray, threads: int) -> Contenders:
    """Return what makes distances up to a bound; the peers have none, and cut off afterwards."""
    free = 1 - occupied.view(np.uint8)

    def opencv() -> Any:
        distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return cv2.min(distance, REACH_CELLS, dst=distance)

    return {
        "mapdeal": lambda: squared_distance(occupied, limit=REACH_CELLS**2),
        "OpenCV": opencv,
    }


def disc(occupied: np.ndarray, threads: int) -> Contenders:
    """Return what inflates by a disc of `DISC_CELLS`."""
    cells = occupied.view(np.uint8)
    free = 1 - cells
    y, x = np.mgrid[-DISC_CELLS : DISC_CELLS + 1, -DISC_CELLS : DISC_CELLS + 1]
    kernel = (x * x + y * y <= DISC_CELLS**2).astype(np.uint8)

    def threshold() -> Any:
        distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return distance <= DISC_CELLS

    return {
        "mapdeal": lambda: within_distance(occupied, DISC_CELLS**2),
        "OpenCV": threshold,
        "OpenCV dilate": lambda: cv2.dilate(cells, kernel),
    }


def exponential(occupied: np.ndarray, threads: int) -> Contenders:
    """Return what makes exponential costs out to `REACH_CELLS`."""
    free = 1 - occupied.view(np.uint8)

    def mapdeal() -> Any:
        layer = InflationLayer(inscribed_radius=INSCRIBED, cost_scaling_factor=FACTOR)
        table = cost_table(REACH_CELLS, layer, RESOLUTION)
        return bytes_by_distance(occupied, table)

    def opencv() -> Any:
        distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        metres = cv2.multiply(distance, RESOLUTION)
        cost = cv2.exp(cv2.multiply(cv2.subtract(metres, INSCRIBED), -FACTOR))
        bytes_ = cv2.multiply(cost, 252.0, dtype=cv2.CV_8U)
        bytes_[metres <= INSCRIBED] = 253
        bytes_[metres > REACH_CELLS * RESOLUTION] = 0
        bytes_[free == 0] = 254
        return bytes_

    return {"mapdeal": mapdeal, "OpenCV": opencv}


TASKS = {
    "signed field": signed,
    "unsigned": unsigned,
    "cut off at 1.75 m": truncated,
    "disc of 0.3 m": disc,
    "costs to 1.75 m": exponential,
}


def seconds_of(work: Callable[[], Any]) -> float:
    """Return the time of one call, without that of giving its result back."""
    started = time.perf_counter()
    result = work()
    seconds = time.perf_counter() - started
    del result
    return seconds


def check(occupied: np.ndarray) -> None:
    """Stop unless the contenders' signed fields are the same, as far as each is exact."""
    fields = {name: work() for name, work in signed(occupied, 1).items()}
    reference = fields.pop("mapdeal")
    for name, field in fields.items():
        # float32 squares and roots: relative 1e-4 tells a wrong cell from rounding
        if not np.allclose(field, reference, rtol=1e-4, atol=1e-6):
            raise SystemExit(f"{name} has made another field")


def copy_bandwidth() -> float:
    """Return bytes read and written per second by a plain copy of 256 MB."""
    source = np.ones(64_000_000, dtype=np.float32)
    target = np.empty_like(source)
    np.copyto(target, source)
    best = min(seconds_of(lambda: np.copyto(target, source)) for _ in range(9))
    return 2 * source.nbytes / best


def measured(contenders: Contenders, runs: int) -> dict[str, list[float]]:
    """Return the times of each contender, the first turn left out."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(runs + 1):
        for name, work in contenders.items():
            seconds = seconds_of(work)
            if turn > 0:
                times[name].append(seconds)
    return times


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", type=int, nargs="+", default=[500, 2000, 4000, 8000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    options = parser.parse_args()
    check(cells_of_map(500))
    print(f"kernels: {engine_name()}\n")
    print(f"| cells a side | threads | task | mapdeal, ms | {' | '.join(COLUMNS)} |")
    print("|---" * (4 + len(COLUMNS)) + "|")
    for side in options.sides:
        occupied = cells_of_map(side)
        for threads in options.threads:
            cv2.setNumThreads(threads)
            for task in options.tasks:
                with use_threads(threads):
                    times = measured(TASKS[task](occupied, threads), options.runs)
                if task == "signed field":
                    # the mask is read twice, the field written once
                    moved = occupied.size * (1 + 1 + 4)
                    times["plain copy"] = [moved / copy_bandwidth()] * options.runs
                print(f"| {side} | {threads} | {task} | {row_of(times)} |", flush=True)


def row_of(times: dict[str, list[float]]) -> str:
    """Return our time, and for each column the ratio to its time, and that in milliseconds."""
    ours = times["mapdeal"]
    cells = [f"{1e3 * statistics.median(ours):.1f}"]
    for name in COLUMNS:
        if name not in times:
            cells.append("")
            continue
        theirs = times[name]
        ratio = statistics.median(a / b for a, b in zip(ours, theirs, strict=True))
        cells.append(f"{ratio:.3g} ({1e3 * statistics.median(theirs):.3g})")
    return " | ".join(cells)


if __name__ == "__main__":
    main()
