"""Times of reading and writing text beside numpy, pandas, polars and a program in C++.

Run it as ``python docs/benchmarks/texts.py [--runs 9] [--rows 1000000] [--log FILE]``; it needs
the extra ``bench`` and g++. Contenders take turns: functions in one process, commands as processes
of their own. Prints tables in Markdown: medians of wall time and of CPU time, which depends less on
other work of the machine, and medians of the pairwise ratios. Fails on nothing.
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
from pathlib import Path
from typing import Any

import numpy as np
from make_map import RESOLUTION, cells_of_map

HERE = Path(__file__).parent
ORIGIN = (1.0, -2.0, 0.4)
SCANS, READINGS = 5556, 180

Times = tuple[float, float]
Contender = Callable[[], Times]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--log", type=Path, help="a CARMEN log of FLASER lines with 180 readings")
    parser.add_argument("--peer", nargs=3, type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        query_by_pandas(*options.peer)
        return
    from mapdeal.kernels.engine import engine_name

    print(f"kernels: {engine_name()}, {len(os.sched_getaffinity(0))} processors\n")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reading(folder, options.rows, options.runs)
        queries(folder, options.rows, options.runs)
        mapping(folder, options.log, options.runs)


def reading(folder: Path, rows: int, runs: int) -> None:
    """Read points and clouds by mapdeal, numpy and polars."""
    import polars as pl

    from mapdeal import read_cloud
    from mapdeal.files.source import chunks_of
    from mapdeal.sensors.points import read_points

    points = np.random.default_rng(0).uniform(-100, 100, (rows, 3))
    short = [" ".join(f"{v:.6f}" for v in row) for row in points.tolist()]
    exact = [",".join(map(repr, row)) for row in points.tolist()]
    names = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    heads = {
        "a.xyz": "",
        "a.pcd": f"VERSION 0.7\n{names}WIDTH {rows}\nHEIGHT 1\nPOINTS {rows}\nDATA ascii\n",
        "a.ply": f"ply\nformat ascii 1.0\nelement vertex {rows}\n{axes}end_header\n",
        "a.csv": "x,y,z\n",
        "points.csv": "x,y\n",
    }
    print(f"reading {rows} rows\n")
    _head()
    for name, head in heads.items():
        lines = exact if name == "a.csv" else short
        if name == "points.csv":
            lines = [",".join(line.split()[:2]) for line in short]
        path = folder / name
        path.write_text(head + "\n".join(lines) + "\n")
        mark = "," if path.suffix == ".csv" else " "
        skipped = head.count("\n")

        def ours(path: Path = path) -> Any:
            if path.name == "points.csv":
                return [part.numbers for part in read_points(chunks_of(path), path)]
            return read_cloud(path)

        def by_numpy(path: Path = path, mark: str = mark, skipped: int = skipped) -> Any:
            return np.loadtxt(path, delimiter=mark, skiprows=skipped)

        def by_polars(path: Path = path, mark: str = mark, skipped: int = skipped) -> Any:
            return pl.read_csv(path, separator=mark, has_header=False, skip_rows=skipped)

        assert np.array_equal(np.concatenate(ours()).reshape(rows, -1), by_numpy())
        digits = "17 digits" if lines is exact else "6 decimals"
        _rows(
            f"{name}, {digits}",
            {
                "mapdeal": _timed(ours),
                "numpy.loadtxt": _timed(by_numpy),
                "polars.read_csv": _timed(by_polars),
            },
            runs,
        )
    print()


def queries(folder: Path, rows: int, runs: int) -> None:
    """Ask a field at points, text in and JSON lines out, each in a process of its own."""
    from mapdeal import OccupancyGrid, esdf
    from mapdeal.maps.npz import write_npz

    occupied = cells_of_map(1000)
    field = esdf(OccupancyGrid(occupied.astype(np.int8) * 100, RESOLUTION, ORIGIN))
    with (folder / "field.npz").open("wb") as file:
        write_npz(file, field)
    places = np.random.default_rng(0).uniform(0, 1000, (rows, 2))
    points = folder / "asked.csv"
    lines = (f"{x:.6f},{y:.6f}\n" for x, y in field.frame.xy_from_continuous_rowcol(places))
    points.write_text("x,y\n" + "".join(lines))
    asked = [str(folder / "field.npz"), str(points), str(folder / "answers.jsonl")]
    ours = [sys.executable, "-m", "mapdeal", "query", asked[0], "--points", asked[1]]
    peer = [sys.executable, str(HERE / "texts.py"), "--peer", *asked]
    print(f"query of {rows} points, whole processes\n")
    _head()
    contenders = {
        "mapdeal query": _run(ours, folder / "ours.jsonl"),
        "pandas, map_coordinates, to_json": _run(peer, None),
    }
    _rows("text in, JSON lines out", contenders, runs)
    print()


def query_by_pandas(source: Path, points: Path, output: Path) -> None:
    """Answer with the same keys, but for the gradient as two of them, and all digits."""
    import pandas as pd
    from scipy import ndimage

    layers = np.load(source)
    distance, occupancy = layers["distance"], layers["occupancy"]
    frame = pd.read_csv(points)
    x, y, yaw = ORIGIN
    cos, sin = math.cos(yaw), math.sin(yaw)
    moved = frame[["x", "y"]].to_numpy() - (x, y)
    places = (moved @ np.array([[-sin, cos], [cos, sin]])).T / RESOLUTION - 0.5

    def at(row: float, col: float) -> np.ndarray:
        shifted = places + np.array([[row], [col]])
        return ndimage.map_coordinates(distance, shifted, order=1, mode="nearest")

    cells = np.floor(places + 0.5).astype(int)
    height, width = distance.shape
    inside = ((cells >= 0) & (cells < [[height], [width]])).all(axis=0)
    row, col = np.clip(cells, 0, [[height - 1], [width - 1]])
    across, along = at(0.5, 0) - at(-0.5, 0), at(0, 0.5) - at(0, -0.5)
    frame["inside"] = inside
    frame["row"], frame["col"] = row, col
    frame["state"] = np.where(occupancy[row, col] >= 65, "occupied", "free")
    frame["distance"] = at(0, 0)
    frame["gradient_x"] = (along * cos - across * sin) / RESOLUTION
    frame["gradient_y"] = (along * sin + across * cos) / RESOLUTION
    frame["cell_distance"] = distance[row, col]
    frame.to_json(output, orient="records", lines=True)


def mapping(folder: Path, log: Path | None, runs: int) -> None:
    """Read a CARMEN log by mapdeal and numpy; count its beams by mapdeal and a program in C++."""
    from mapdeal.sensors.scans import open_log

    source, program = folder / "million.log", folder / "count_beams"
    write_log(source, log)
    words = ["g++", "-O2", "-o", str(program), str(HERE / "count_beams.cpp")]
    subprocess.run(words, check=True)
    ours = [sys.executable, "-m", "mapdeal", "build", str(source), "-q", "--force", "-o",
            str(folder / "map.yaml"), "--method", "counting"]  # fmt: skip
    size = source.stat().st_size / 1e6
    print(f"a log of {SCANS * READINGS} beams, {size:.1f} MB, in one process\n")
    _head()
    readings = range(2, 2 + READINGS)
    read = {
        "mapdeal": _timed(lambda: [part.ranges for part in open_log(source).scans()]),
        "numpy.loadtxt": _timed(lambda: np.loadtxt(source, usecols=readings)),
    }
    _rows("scans", read, runs)
    print("\nwhole processes\n")
    _head()
    contenders = {
        "mapdeal build": _run(ours, None),
        "C++, -O2": _run([str(program), str(source), str(folder / "peer.pgm")], None),
        "mapdeal --version": _run([sys.executable, "-m", "mapdeal", "--version"], None),
    }
    wall = _rows("counting", contenders, runs)
    print(f"\n{SCANS * READINGS / wall / 1e6:.2f} million beams a second of wall time\n")


def write_log(path: Path, log: Path | None) -> None:
    """Write a log of scans in a simulated hall, or of those of another log again and again."""
    if log is None:
        from mapping import cast, walls

        turn = np.linspace(0, 40 * math.pi, SCANS, endpoint=False)
        poses = np.column_stack([5.6 + 4.2 * np.cos(turn), 4 + 2.4 * np.sin(turn), turn + 1.5])
        angles = np.radians(np.arange(READINGS) - 90.0)
        readings = cast(poses, walls(), 0.01, angles).ranges
        scans = [" ".join(f"{one:.2f}" for one in row) for row in readings.tolist()]
        places = [" ".join(f"{one:.6f}" for one in pose) for pose in poses.tolist()]
    else:
        lines = [line.split() for line in log.read_text().splitlines()]
        lines = [words for words in lines if words[:2] == ["FLASER", str(READINGS)]]
        lines = [lines[k % len(lines)] for k in range(SCANS)]
        scans = [" ".join(words[2 : 2 + READINGS]) for words in lines]
        places = [" ".join(words[2 + READINGS : 5 + READINGS]) for words in lines]
    path.write_text(
        "".join(
            f"FLASER {READINGS} {scan} {place} {place} {k / 10:.6f} host {k / 10:.6f}\n"
            for k, (scan, place) in enumerate(zip(scans, places, strict=True))
        )
    )


def _timed(work: Callable[[], Any]) -> Contender:
    def timed() -> Times:
        wall, processor = time.perf_counter(), time.process_time()
        work()
        return time.perf_counter() - wall, time.process_time() - processor

    return timed


def _run(words: list[str], output: Path | None) -> Contender:
    """Return what runs a command, its answers going into a file."""
    # Compiled bytecode is kept, as in any installation.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}

    def timed() -> Times:
        with Path(output or os.devnull).open("wb") as file:
            wall = time.perf_counter()
            process = subprocess.Popen(words, stdout=file, env=environment)
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.perf_counter() - wall
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{words} ended with {process.returncode}")
        return wall, usage.ru_utime + usage.ru_stime

    return timed


def _head() -> None:
    print("| what | contender | seconds | CPU seconds | mapdeal to it | in CPU time |")
    print("|---|---|---|---|---|---|")


def _rows(what: str, contenders: dict[str, Contender], runs: int) -> float:
    """Print the rows of some contenders; return the median wall time of the first."""
    times: dict[str, list[Times]] = {name: [] for name in contenders}
    for turn in range(runs + 1):
        for name, work in contenders.items():
            found = work()
            if turn:  # the first is a warm-up
                times[name].append(found)
    ours = next(iter(times.values()))
    for name, seconds in times.items():
        medians = [statistics.median(one[k] for one in seconds) for k in (0, 1)]
        pairs = list(zip(ours, seconds, strict=True))
        ratios = [statistics.median(a[k] / b[k] for a, b in pairs) for k in (0, 1)]
        print(f"| {what} | {name} | {medians[0]:.3f} | {medians[1]:.3f} | {ratios[0]:.2f} | "
              f"{ratios[1]:.2f} |")  # fmt: skip
    return statistics.median(wall for wall, _ in ours)


if __name__ == "__main__":
    main()
