"""Times of the stages from a map to a field and costs, as ratios to OpenCV and to plain copies.

Run it as ``python docs/benchmarks/stages.py [--sides 2000 4000] [--threads 1 2] [--runs 9]``; it
needs the extra ``bench``. Contenders take turns, each with a fresh result. Costs and views of a
field that is there already are compared with the time in which numpy copies 10 bytes a cell: what
they read and write is half of that. Prints a table in Markdown: medians in milliseconds, and the
median of the pairwise ratios.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION
from shapes import maps, timed

from mapdeal import OccupancyGrid, esdf, exponential_cost, field_view, threshold_cost
from mapdeal.kernels.threads import use_threads

REACH, INSCRIBED, FACTOR = 1.75, 0.3, 3.0  # metres, metres, 1 / metre

Work = tuple[str, Callable[[], Any], str, Callable[[], Any]]


def works_of(occupied: np.ndarray) -> list[Work]:
    """Return what is compared on a map: names and calls of both sides."""
    values = np.where(occupied, 100, 0).astype(np.int8)
    grid = OccupancyGrid(values, RESOLUTION)
    field = esdf(grid)
    bytes_ = np.ones(10 * occupied.size, np.uint8)
    target = np.empty_like(bytes_)

    def transforms() -> Any:
        cells = (values >= 100).view(np.uint8)
        outside = cv2.distanceTransform(1 - cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside = cv2.distanceTransform(cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        signed = cv2.subtract(outside, inside)
        return cv2.multiply(signed, RESOLUTION, dst=signed)

    def table() -> Any:
        cells = (values >= 100).view(np.uint8)
        distance = cv2.distanceTransform(1 - cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        metres = cv2.multiply(distance, RESOLUTION)
        cost = cv2.exp(cv2.multiply(cv2.subtract(metres, INSCRIBED), -FACTOR))
        costs = cv2.multiply(cost, 252.0, dtype=cv2.CV_8U)
        costs[metres <= INSCRIBED] = 253
        costs[metres > REACH] = 0
        costs[cells > 0] = 254
        return costs

    def copied() -> None:
        np.copyto(target, bytes_)

    return [
        ("signed field", lambda: esdf(grid).distance, "OpenCV, two transforms", transforms),
        (
            "exponential costs, 1.75 m",
            lambda: exponential_cost(
                grid, inscribed_radius=INSCRIBED, inflation_radius=REACH,
                cost_scaling_factor=FACTOR,
            ).cost,
            "OpenCV, transform and table", table,
        ),
        (
            "exponential costs of a field",
            lambda: exponential_cost(
                field, inscribed_radius=INSCRIBED, inflation_radius=REACH,
                cost_scaling_factor=FACTOR,
            ).cost,
            "copy of 10 bytes a cell", copied,
        ),
        (
            "threshold costs of a field", lambda: threshold_cost(field).cost,
            "copy of 10 bytes a cell", copied,
        ),
        (
            "view of a field, metric", lambda: field_view(field, view="metric").occupancy,
            "copy of 10 bytes a cell", copied,
        ),
        (
            "view of a field, relative", lambda: field_view(field).occupancy,
            "copy of 10 bytes a cell", copied,
        ),
    ]  # fmt: skip


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    words.add_argument("--sides", type=int, nargs="+", default=[2000, 4000])
    words.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    words.add_argument("--runs", type=int, default=9)
    given = words.parse_args()
    print("| map | work | threads | mapdeal, ms | peer | peer, ms | ratio |")
    print("|---|---|---|---|---|---|---|")
    for side in given.sides:
        for name, occupied in maps(side):
            works = works_of(occupied)
            for threads in given.threads:
                cv2.setNumThreads(threads)
                for work, ours, peer, theirs in works:
                    with use_threads(threads):
                        ours(), theirs()
                        pairs = [(timed(ours), timed(theirs)) for _ in range(given.runs)]
                    mine, other = (statistics.median(one) * 1e3 for one in zip(*pairs, strict=True))
                    ratio = statistics.median(a / b for a, b in pairs)
                    print(
                        f"| {name} | {work} | {threads} | {mine:.1f} | {peer} | {other:.1f} "
                        f"| {ratio:.2f} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
