"""Local maps a second, from files to files, beside a hand-written loop on OpenCV.

Run it as ``python docs/benchmarks/local_maps.py [--runs 3] [--clouds 60]``; it needs the extra
``bench``. Windows of 8 m x 8 m at 0.05 m, 70,000 points a cloud in binary PCD. Whole processes
take turns. Prints a table in Markdown: medians. Fails on nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

POINTS = 70_000
SIZE, RESOLUTION, RADIUS = 8.0, 0.05, 0.3  # metres
HEADER = (
    "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
    f"WIDTH {POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\nDATA binary\n"
)
LOOP = "hand-written loop, no pictures"
MAPDEAL = [sys.executable, "-m", "mapdeal", "local", "-q", "--size", f"{SIZE},{SIZE}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--clouds", type=int, default=60)
    parser.add_argument("--peer", type=Path, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        peer(*options.peer)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_clouds(folder, options.clouds)
        sequence = ["--cloud", str(folder / "clouds"), "--poses", str(folder / "poses.txt")]
        local = [*MAPDEAL, *sequence]
        contenders = {
            "`mapdeal local --no-images`": [*local, "--no-images", "-o"],
            "the same, `--threads 1`": [*local, "--no-images", "--threads", "1", "-o"],
            "rolling, `--keep 10 --no-images`": [*local, "--keep", "10", "--no-images", "-o"],
            "`mapdeal local`, with pictures": [*local, "-o"],
            LOOP: [
                sys.executable, __file__, "--peer", str(folder / "clouds"),
                str(folder / "poses.txt"),
            ],
        }  # fmt: skip
        times: dict[str, list[float]] = {name: [] for name in contenders}
        for turn in range(options.runs):
            for number, (name, command) in enumerate(contenders.items()):
                # never the same folder: file systems make files slowly where some were removed
                out = str(folder / f"out{turn}-{number}")
                started = time.perf_counter()
                subprocess.run([*command, out], check=True)
                times[name].append(time.perf_counter() - started)
        print(f"{options.clouds} clouds of {POINTS} points\n")
        print("| contender | maps a second | milliseconds a map | to the loop |\n|---|---|---|---|")
        for name, seconds in times.items():
            each = statistics.median(seconds) / options.clouds
            pairs = zip(seconds, times[LOOP], strict=True)
            ratio = statistics.median(own / other for own, other in pairs)
            print(f"| {name} | {1 / each:.1f} | {1000 * each:.1f} | {ratio:.2f} |")


def make_clouds(folder: Path, count: int) -> None:
    """Write clouds of a room with a floor and boxes, and a pose for each."""
    (folder / "clouds").mkdir()
    rng = np.random.default_rng(0)
    lines = []
    for k in range(count):
        angle = rng.uniform(-math.pi, math.pi, POINTS)
        wall = 3.5 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
        distance = np.where(np.sin(7 * angle) > 0.9, 2.0, wall) + rng.normal(0, 0.01, POINTS)
        height = rng.uniform(-0.3, 2.0, POINTS)
        rows = np.stack(
            [distance * np.cos(angle), distance * np.sin(angle), height, height], axis=1
        )
        path = folder / "clouds" / f"{k}.pcd"
        path.write_bytes(HEADER.encode() + rows.astype("<f4").tobytes())
        lines.append(f"{0.02 * k:.2f} {-0.01 * k:.2f} {0.01 * k:.2f}")
    (folder / "poses.txt").write_text("\n".join(lines))


def peer(clouds: Path, poses: Path, out: Path) -> None:
    """Do as a script would that somebody writes for the purpose."""
    import cv2

    cells = round(SIZE / RESOLUTION)
    reach = math.ceil(RADIUS / RESOLUTION)
    rows, cols = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    disc = (np.hypot(rows, cols) * RESOLUTION <= RADIUS + 1e-9).astype(np.uint8)
    square = np.ones((3, 3), np.uint8)
    for k, (x, y, yaw) in enumerate(np.loadtxt(poses)):
        data = (clouds / f"{k}.pcd").read_bytes()
        points = np.frombuffer(data, "<f4", offset=len(HEADER)).reshape(-1, 4)[:, :2]
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        origin = np.floor(np.array([x - SIZE / 2, y - SIZE / 2]) / RESOLUTION) * RESOLUTION
        at = np.floor((points @ turn + (x, y) - origin) / RESOLUTION).astype(int)
        at = at[(at >= 0).all(axis=1) & (at < cells).all(axis=1)]
        local = np.zeros((cells, cells), np.uint8)
        local[at[:, 1], at[:, 0]] = 100
        inflated = cv2.dilate(local, disc)
        outside = cv2.distanceTransform((inflated == 0).astype(np.uint8), cv2.DIST_L2, 5)
        inside = cv2.distanceTransform((inflated > 0).astype(np.uint8), cv2.DIST_L2, 5)
        field = (outside - np.maximum(inside - 1, 0)) * RESOLUTION
        view = np.trunc(100 * (1 - np.clip(field, 0, 2) / 2)).astype(np.uint8)
        cost, grown = inflated.copy(), inflated
        for value in (90, 70, 50):
            wider = cv2.dilate(grown, square)
            cost[(wider > 0) & (grown == 0)] = value
            grown = wider
        folder = out / f"{k:04}"
        folder.mkdir(parents=True)
        for name, image in (
            ("local", local),
            ("inflated", inflated),
            ("esdf", view),
            ("cost", cost),
        ):
            cv2.imwrite(str(folder / f"{name}.pgm"), image[::-1])
            text = (
                f"image: {name}.pgm\nresolution: {RESOLUTION}\norigin: {[*origin.tolist(), 0.0]}\n"
            )
            (folder / f"{name}.yaml").write_text(text)
        np.savez_compressed(folder / "esdf.npz", distance=field)
        np.savez_compressed(folder / "cost.npz", cost=cost)
        manifest = {
            "inputs": {f"{k}.pcd": hashlib.sha256(data).hexdigest()},
            "pose": [x, y, yaw],
            "outputs": sorted(path.name for path in folder.iterdir()),
        }
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=2))
        for path in (*folder.iterdir(), folder):
            descriptor = os.open(path, os.O_RDONLY)
            os.fsync(descriptor)
            os.close(descriptor)


if __name__ == "__main__":
    main()
