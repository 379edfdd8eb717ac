"""Times of poses and the ways between them beside OpenCV and scipy, in one process.

Run it as ``python docs/benchmarks/robot_poses.py [--sides 300 1000 4000] [--threads 1 2]
[--runs 5]``; it needs the extra ``bench``. A robot's footprint in 72 headings: the cells in which
it can stand in any of them, and those that it reaches from one. OpenCV erodes the free cells by
the footprint of each heading; scipy, too, on the smallest map, as both take minutes on large ones.
scipy labels what is left, and joins the components of neighbouring headings where they overlap.
Prints a table in Markdown: medians, the median of the pairwise ratios, and whether all reach the
same cells. Fails on nothing.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION, pixels_of_map
from scipy import ndimage, sparse

from mapdeal import Footprint
from mapdeal.grid.footprint import footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.paths import ConfigurationSpace
from mapdeal.kernels.polygons import Spans, paint
from mapdeal.kernels.threads import use_threads

HEADINGS = 72
ROBOTS = {"0.9 m x 0.45 m, 5 cm": (0.9, 0.45, RESOLUTION), "2 m x 1 m, 2.5 cm": (2.0, 1.0, 0.025)}

Contenders = dict[str, Callable[[], Any]]


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", type=int, nargs="+", default=[300, 1000, 4000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--opencv-up-to", type=int, default=1000)
    parser.add_argument("--scipy-up-to", type=int, default=300)
    options = parser.parse_args()
    print(f"kernels: {engine_name()}\n")
    print("| map | cells a side | robot | threads | mapdeal: poses, ms | ways, ms "
          "| OpenCV and scipy | scipy | same cells |")  # fmt: skip
    print("|---" * 9 + "|")
    for side in options.sides:
        for name, blocked in maps(side):
            for robot, (length, width, resolution) in ROBOTS.items():
                frame = Frame(side, side, resolution)
                spans = footprint_spans(rectangle(length, width), frame, HEADINGS)
                for threads in options.threads:
                    peers = [side <= options.opencv_up_to, side <= options.scipy_up_to]
                    told = row(blocked, spans, threads, options.runs, *peers)
                    print(f"| {name} | {side} | {robot} | {threads} | {told} |", flush=True)


def maps(side: int) -> Any:
    """Yield names and masks of blocked cells."""
    yield "office", np.ascontiguousarray(pixels_of_map(side)[::-1] != 254)
    rng = np.random.default_rng(side)
    yield "sparse", rng.random((side, side)) < 0.0003


def rectangle(length: float, width: float) -> Footprint:
    """Return a robot that turns around its middle."""
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return Footprint.polygon([(x * length / 2, y * width / 2) for x, y in signs])


def row(
    blocked: np.ndarray,
    spans: tuple[Spans, ...],
    threads: int,
    runs: int,
    with_opencv: bool,
    with_scipy: bool,
) -> str:
    """Return our times of both parts, the ratios to others, and whether results are the same."""
    cv2.setNumThreads(threads)
    with use_threads(threads):
        space = ConfigurationSpace(blocked, spans)
        middle = np.argwhere(space.headings == space.headings.max())
        cell = tuple(middle[len(middle) // 2].tolist())
        seed = (int(space.open_headings(*cell).argmax()), *cell)
        kernels = [kernel_of(one) for one in spans]
        parts: list[tuple[float, float]] = []

        def ours() -> Any:
            start = time.perf_counter()
            poses = ConfigurationSpace(blocked, spans)
            between = time.perf_counter()
            reachable = poses.reach([seed]).reachable
            parts.append((between - start, time.perf_counter() - between))
            return reachable

        contenders: Contenders = {"mapdeal": ours}
        if with_opencv:
            contenders["OpenCV"] = lambda: joined(by_opencv(blocked, kernels), blocked.shape, seed)
        if with_scipy:
            contenders["scipy"] = lambda: joined(by_scipy(blocked, kernels), blocked.shape, seed)
        times, results = measured(contenders, runs)
    same = [np.array_equal(results["mapdeal"], other) for other in results.values()][1:]
    medians = [1e3 * statistics.median(part) for part in zip(*parts[1:], strict=True)]
    told = [f"{median:.1f}" for median in medians]
    for name in ("OpenCV", "scipy"):
        if name in times:
            ratios = [a / b for a, b in zip(times["mapdeal"], times[name], strict=True)]
            median = statistics.median(times[name])
            told.append(f"{statistics.median(ratios):.2g} ({median:.2g} s)")
        else:
            told.append("")
    return " | ".join([*told, ("yes" if all(same) else "NO") if same else ""])


def kernel_of(spans: Spans) -> np.ndarray:
    """Return a square of 0 and 1, the robot's cell in the middle."""
    reach = int(max(np.abs(spans.rows).max(), np.abs(spans.starts).max(), spans.stops.max()))
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
    paint(kernel, Spans(spans.rows + reach, spans.starts + reach, spans.stops + reach), 1)
    return kernel


def by_opencv(blocked: np.ndarray, kernels: list[np.ndarray]) -> Any:
    """Yield the open cells of each heading."""
    free = 1 - blocked.view(np.uint8)
    for kernel in kernels:
        yield cv2.erode(free, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)


def by_scipy(blocked: np.ndarray, kernels: list[np.ndarray]) -> Any:
    """Yield the open cells of each heading."""
    for kernel in kernels:
        yield ndimage.binary_erosion(~blocked, kernel)


def joined(planes: Any, shape: tuple[int, int], seed: tuple[int, int, int]) -> np.ndarray:
    """Return the cells that are reached, of the open ones of each heading; keeps all labels."""
    labels, pairs, start = [], [], 0
    for plane in planes:
        of_plane, count = ndimage.label(plane)
        of_plane[of_plane > 0] += start
        labels.append(of_plane)
        start += count
    for k, one in enumerate(labels):
        other = labels[(k + 1) % len(labels)]
        both = (one > 0) & (other > 0)
        pairs.append(np.unique(one[both].astype(np.int64) << 32 | other[both]))
    one, other = np.concatenate(pairs) >> 32, np.concatenate(pairs) & 0xFFFFFFFF
    graph = sparse.coo_matrix((np.ones(len(one)), (one, other)), shape=(start + 1, start + 1))
    groups = sparse.csgraph.connected_components(graph, directed=False)[1]
    is_reached = groups == groups[labels[seed[0]][seed[1], seed[2]]]
    is_reached[0] = False
    reachable = np.zeros(shape, dtype=np.bool_)
    for of_plane in labels:
        reachable |= is_reached[of_plane]
    return reachable


def measured(contenders: Contenders, runs: int) -> tuple[dict[str, list[float]], dict[str, Any]]:
    """Return the times of each contender, the first turn left out, and what it made."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    results: dict[str, Any] = {}
    for turn in range(runs + 1):
        for name, work in contenders.items():
            start = time.perf_counter()
            results[name] = work()
            if turn:
                times[name].append(time.perf_counter() - start)
    return times, results


if __name__ == "__main__":
    main()
