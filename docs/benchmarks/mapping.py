"""The three methods of mapping compared: accuracy on a simulated run, and speed.

Run it as ``python docs/benchmarks/mapping.py [--runs 5] [--log FILE]``; it needs the extra
``bench``. The scanner sees walls that are known exactly, as line segments. Prints tables in
Markdown: medians. With a CARMEN log, times are taken on it, too. Fails on nothing.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from skimage.draw import line

from mapdeal import BeamLimits, BuiltMap, MapBuilder, Scans, build_map
from mapdeal.kernels.engine import VARIABLE, engine_name
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.build import METHODS, Extent
from mapdeal.mapping.evidence import beams_of
from mapdeal.sensors.scans import open_log

RESOLUTION = 0.05
ANGLES = np.radians(np.arange(-135, 135.25, 0.5))
BYTES_PER_CELL = {"log-odds": 5, "counting": 8, "tsdf": 20}


def walls() -> np.ndarray:
    """Return the ends of all walls, shape (N, 4): a hall, a thin wall, slanted walls, a pillar."""
    corners = [(0.03, 0.02), (12.04, 0.02), (12.04, 5.2), (9.4, 8.01), (0.03, 8.01)]
    outline = zip(corners, corners[1:] + corners[:1], strict=True)
    segments = [(*a, *b) for a, b in outline]
    segments += [(4.013, 0.02, 4.013, 3.1), (4.093, 0.02, 4.093, 3.1), (4.013, 3.1, 4.093, 3.1)]
    segments += [(6.0, 8.01, 7.7, 4.9)]
    return np.array([*segments, *circle(9, 3, 0.4)])


def circle(x: float, y: float, radius: float) -> list[tuple[float, ...]]:
    """Return a circle as segments."""
    turns = np.linspace(0, 2 * math.pi, 25)
    corners = [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in turns]
    return [(*a, *b) for a, b in pairwise(corners)]


def simulated(noise: float, count: int = 150) -> Scans:
    """Return scans along a loop through the hall, their ranges with normal noise, metres."""
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    poses = np.column_stack([5.6 + 4.6 * np.cos(turn), 4 + 2.6 * np.sin(turn), turn + math.pi / 2])
    poses[:, 1] += np.where(np.abs(poses[:, 0] - 4.05) < 0.5, 0.6, 0.0)
    return cast(poses, walls(), noise)


def cast(
    poses: np.ndarray, segments: np.ndarray, noise: float, angles: np.ndarray = ANGLES
) -> Scans:
    """Return what a scanner sees of segments, (N, 4), from poses."""
    a, b = segments[:, :2], segments[:, 2:]
    ranges = np.empty((len(poses), len(angles)))
    for k, (x, y, yaw) in enumerate(poses):
        direction = np.stack([np.cos(yaw + angles), np.sin(yaw + angles)], axis=1)[:, np.newaxis]
        along, start = b - a, a - np.array([x, y])
        det = direction[..., 0] * along[:, 1] - direction[..., 1] * along[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / det
            share = (start[:, 0] * direction[..., 1] - start[:, 1] * direction[..., 0]) / det
        reach[~((reach > 0) & (share >= 0) & (share <= 1))] = np.inf
        ranges[k] = reach.min(axis=1)
    rng = np.random.default_rng(1)
    return Scans(poses, angles, ranges + rng.normal(0, noise, ranges.shape))


def legs() -> None:
    """Print how many of 30 thin round legs each method keeps."""
    rng = np.random.default_rng(2)
    middles = rng.uniform((0.5, 0.5), (7.5, 5.5), (30, 2))
    poses = np.column_stack([rng.uniform(1, 7, 30), rng.uniform(1, 5, 30), rng.uniform(-3, 3, 30)])
    room = [(0, 0, 8, 0), (8, 0, 8, 6), (8, 6, 0, 6), (0, 6, 0, 0)]
    print("\n| legs kept of 30, noise of 10 mm | 30 mm wide | 40 mm | 60 mm | 100 mm |")
    print("|---|---|---|---|---|")
    for method in METHODS:
        kept = []
        for width in (0.03, 0.04, 0.06, 0.1):
            leg_walls = [part for x, y in middles for part in circle(x, y, width / 2)]
            scans = cast(poses, np.array([*room, *leg_walls], dtype=float), 0.01)
            built = build_map(scans.poses, scans.angles, scans.ranges, method=method)
            occupied = built.grid.frame.xy_from_rowcol(np.argwhere(built.grid.occupied()))
            distance, _ = cKDTree(occupied).query(middles)
            kept.append(int((distance < 1.5 * RESOLUTION).sum()))
        print(f"| {method} | {' | '.join(map(str, kept))} |")


def distance_to_walls(points: np.ndarray) -> np.ndarray:
    """Return the distance of each point to the nearest wall, metres."""
    a, b = walls()[:, :2], walls()[:, 2:]
    along = b - a
    share = ((points[:, np.newaxis] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
    nearest = a + np.clip(share, 0, 1)[..., np.newaxis] * along
    return np.linalg.norm(points[:, np.newaxis] - nearest, axis=2).min(axis=1)


def seen_pieces() -> np.ndarray:
    """Return the middles of all pieces of wall, 1 cm long, that a beam without noise ends at."""
    pieces = []
    for x, y, u, v in walls():
        count = max(1, round(math.hypot(u - x, v - y) / 0.01))
        share = (np.arange(count)[:, np.newaxis] + 0.5) / count
        pieces.append(np.array([x, y]) + share * np.array([u - x, v - y]))
    points = np.concatenate(pieces)
    ends = beams_of(simulated(0.0), BeamLimits()).ends_xy()
    distance, _ = cKDTree(ends).query(points)
    return points[distance < 0.02]


def accuracy(built: BuiltMap, seen: np.ndarray) -> list[str]:
    """Return the figures of a map: of its walls, their completeness and thickness, free space."""
    grid = built.grid
    occupied = grid.frame.xy_from_rowcol(np.argwhere(grid.occupied()))
    error = distance_to_walls(occupied)
    gaps, _ = cKDTree(occupied).query(seen)
    found = (gaps <= 1.5 * RESOLUTION).mean()
    free = grid.frame.xy_from_rowcol(np.argwhere(grid.occupancy == 0))
    wrong = (distance_to_walls(free) < RESOLUTION / 4).mean()
    thickness = len(occupied) * RESOLUTION / (len(seen) * 0.01)
    return [
        f"{1000 * np.median(error):.0f}", f"{1000 * np.quantile(error, 0.95):.0f}",
        f"{100 * found:.1f}", f"{thickness:.2f}", f"{100 * wrong:.2f}",
    ]  # fmt: skip


def compare(noise: float) -> None:
    """Print the accuracy of all methods."""
    scans = simulated(noise)
    seen = seen_pieces()
    print(f"\nnoise of {1000 * noise:g} mm, {scans.ranges.size} beams\n")
    print("| method | wall error, median, mm | 95 % | walls found, % | cells across | "
          "free cells in walls, % | bytes a cell |\n|---|---|---|---|---|---|---|")  # fmt: skip
    for method in METHODS:
        built = build_map(scans.poses, scans.angles, scans.ranges, method=method)
        print(f"| {method} | {' | '.join(accuracy(built, seen))} | {BYTES_PER_CELL[method]} |")
        if method == "tsdf":
            surface = distance_to_walls(built.layers["surface"])
            figures = f"{1000 * np.median(surface):.0f} | {1000 * np.quantile(surface, 0.95):.0f}"
            print(f"| its surface, in parts of cells | {figures} | | | | |")


def speed(scans: list[Scans], runs: int, name: str) -> None:
    """Print beams a second of each method and engine, and of a loop on scikit-image's lines."""
    extent = Extent(BeamLimits(), 2 * RESOLUTION)
    for part in scans:
        extent.add(part)
    frame = extent.frame(RESOLUTION)
    beams = sum(part.ranges.size for part in scans)

    def built(method: str, threads: int) -> Callable[[], Any]:
        def run() -> Any:
            with use_threads(threads):
                builder = MapBuilder(frame, method)  # type: ignore[arg-type]
                for part in scans:
                    builder.add(part)
                return builder

        return run

    def looped() -> Any:
        hits, misses = np.zeros((2, *frame.shape), dtype=np.int32)
        for part in scans:
            found = beams_of(part, BeamLimits())
            starts = frame.unbounded_rowcol_from_xy(found.sensors_xy)
            ends = frame.unbounded_rowcol_from_xy(found.ends_xy())
            for (row, col), (last_row, last_col) in zip(starts, ends, strict=True):
                rows, cols = line(row, col, last_row, last_col)
                misses[rows[:-1], cols[:-1]] += 1
                hits[last_row, last_col] += 1
        return hits, misses

    contenders: dict[str, Callable[[], Any]] = {}
    for method in METHODS:
        contenders[f"{method}, 1 thread"] = built(method, 1)
        contenders[f"{method}, 2 threads"] = built(method, 2)
        contenders[f"{method}, numpy twin"] = _on_twin(built(method, 1))
    contenders["counting, a loop on scikit-image's lines"] = looped
    times: dict[str, list[float]] = {contender: [] for contender in contenders}
    for _ in range(runs):
        for contender, run in contenders.items():
            started = time.perf_counter()
            run()
            times[contender].append(time.perf_counter() - started)
    shape = f"{frame.width} x {frame.height}"
    print(f"\n{name}: {beams} beams into {shape} cells\n")
    print("| contender | seconds | million beams a second |\n|---|---|---|")
    for contender, seconds in times.items():
        median = statistics.median(seconds)
        print(f"| {contender} | {median:.3f} | {beams / median / 1e6:.2f} |")


def _on_twin(run: Callable[[], Any]) -> Callable[[], Any]:
    def on_twin() -> Any:
        os.environ[VARIABLE] = "scipy"
        try:
            return run()
        finally:
            del os.environ[VARIABLE]

    return on_twin


def whole_process(log: Path, runs: int) -> None:
    """Print the time of the whole command, log in and map out."""
    print("\n| command | seconds |\n|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for method in METHODS:
            command = [sys.executable, "-m", "mapdeal", "build", str(log), "-q", "--force", "-o",
                       f"{folder}/m.yaml", "--method", method]  # fmt: skip
            seconds = []
            for _ in range(runs):
                started = time.perf_counter()
                subprocess.run(command, check=True)
                seconds.append(time.perf_counter() - started)
            print(f"| build --method {method} | {statistics.median(seconds):.2f} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    print(f"kernels: {engine_name()}")
    for noise in (0.0, 0.01, 0.03):
        compare(noise)
    legs()
    if options.log is None:
        speed([simulated(0.01)], options.runs, "simulated")
        return
    parts = [Scans(*arrays) for arrays in open_log(options.log).scans()]
    speed(parts, options.runs, options.log.name)
    whole_process(options.log, options.runs)


if __name__ == "__main__":
    main()
