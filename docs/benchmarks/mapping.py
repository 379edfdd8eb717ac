"""Accuracy of the three methods of mapping on a simulated run, and with a log their speed.

Run it as ``python docs/benchmarks/mapping.py [--runs 5] [--log FILE]``. The scanner sees walls that
are known exactly, as line segments. The log is one of CARMEN.
"""

import math
import os
import sys
import tempfile
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from skimage.draw import line
from turns import Contender, head, in_turns, options, row

from mapdeal import BeamLimits, BuiltMap, MapBuilder, Scans, build_map
from mapdeal.grid.frame import Frame
from mapdeal.kernels.engine import VARIABLE
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.build import METHODS, Extent
from mapdeal.mapping.evidence import beams_of
from mapdeal.sensors.scans import open_log

RESOLUTION, NOISE = 0.05, 0.03  # metres
ANGLES = np.radians(np.arange(-135, 135.25, 0.5))


def walls() -> np.ndarray:
    """Return the ends of all walls, shape (N, 4): a hall, a thin wall, slanted walls, a pillar."""
    corners = [(0.03, 0.02), (12.04, 0.02), (12.04, 5.2), (9.4, 8.01), (0.03, 8.01)]
    outline = [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    thin = [(4.013, 0.02, 4.013, 3.1), (4.093, 0.02, 4.093, 3.1), (4.013, 3.1, 4.093, 3.1)]
    turns = np.linspace(0, 2 * math.pi, 25)
    round_ = np.stack([9 + 0.4 * np.cos(turns), 3 + 0.4 * np.sin(turns)], axis=1)
    pillar = [(*a, *b) for a, b in pairwise(round_)]
    return np.array([*outline, *thin, (6.0, 8.01, 7.7, 4.9), *pillar])


def simulated(noise: float) -> Scans:
    """Return scans along a loop through the hall, their ranges with normal noise, metres."""
    turn = np.linspace(0, 2 * math.pi, 150, endpoint=False)
    poses = np.column_stack([5.6 + 4.6 * np.cos(turn), 4 + 2.6 * np.sin(turn), turn + math.pi / 2])
    poses[:, 1] += np.where(np.abs(poses[:, 0] - 4.05) < 0.5, 0.6, 0.0)
    return cast(poses, walls(), noise, ANGLES)


def cast(poses: np.ndarray, segments: np.ndarray, noise: float, angles: np.ndarray) -> Scans:
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
    distance, _ = cKDTree(beams_of(simulated(0.0), BeamLimits()).ends_xy()).query(points)
    return points[distance < 0.02]


def accuracy(built: BuiltMap, seen: np.ndarray) -> list[str]:
    """Return the figures of a map's walls: their error, completeness and thickness."""
    grid = built.grid
    occupied = grid.frame.xy_from_rowcol(np.argwhere(grid.occupied()))
    median, most = 1000 * np.quantile(distance_to_walls(occupied), (0.5, 0.95))
    gaps, _ = cKDTree(occupied).query(seen)
    found = 100 * (gaps <= 1.5 * RESOLUTION).mean()
    across = len(occupied) * RESOLUTION / (len(seen) * 0.01)
    return [f"{median:.0f} / {most:.0f}", f"{found:.1f}", f"{across:.2f}"]


def contenders(scans: list[Scans], frame: Frame) -> dict[str, Contender]:
    def built(method: Any) -> None:
        builder = MapBuilder(frame, method)
        for part in scans:
            builder.add(part)

    def on_twin() -> None:
        os.environ[VARIABLE] = "scipy"
        built("counting")
        del os.environ[VARIABLE]

    def looped() -> None:
        hits, misses = np.zeros((2, *frame.shape), dtype=np.int32)
        for part in scans:
            found = beams_of(part, BeamLimits())
            starts = frame.unbounded_rowcol_from_xy(found.sensors_xy)
            ends = frame.unbounded_rowcol_from_xy(found.ends_xy())
            for start, end in zip(starts, ends, strict=True):
                rows, cols = line(*start, *end)
                misses[rows[:-1], cols[:-1]] += 1
                hits[tuple(end)] += 1

    peers = {"counting, numpy twin": on_twin, "counting, a loop on scikit-image's lines": looped}
    return {method: partial(built, method) for method in METHODS} | peers


def speed(log: Path, runs: int) -> None:
    """Print the times of the evidence, and of the whole command, log in and map out."""
    scans = [Scans(*arrays) for arrays in open_log(log).scans()]
    extent = Extent(BeamLimits(), 2 * RESOLUTION)
    for part in scans:
        extent.add_beams(beams_of(part, BeamLimits()))
    beams = sum(part.ranges.size for part in scans)
    head("contender", "seconds", "million beams a second")
    with tempfile.TemporaryDirectory() as folder:
        listed = contenders(scans, extent.frame(RESOLUTION))
        for method in METHODS:
            words = ["-m", "mapdeal", "build", str(log), "-q", "--force", "--method", method]
            listed[f"build --method {method}"] = [sys.executable, *words, "-o", f"{folder}/m.yaml"]
        with use_threads(1):
            measured = in_turns(listed, runs)
        for name, times in measured.items():
            row(name, f"{times.median:.3f}", f"{beams / times.median / 1e6:.2f}")


if __name__ == "__main__":
    given = options(__doc__, runs=5, log=None)
    scans, seen = simulated(NOISE), seen_pieces()
    head("method", "wall error, median / 95 %, mm", "walls found, %", "cells across")
    for method in METHODS:
        built = build_map(scans.poses, scans.angles, scans.ranges, method=method)
        row(method, *accuracy(built, seen))
    if given.log:
        print()
        speed(given.log, given.runs)
