"""Times of reading and writing text beside numpy, pandas, polars and a program in C++.

Run it as ``python docs/benchmarks/texts.py [--runs 9] [--rows 1000000]``; it needs g++. Functions
run in one process, commands as processes of their own. CPU time depends less than wall time on
other work of the machine.
"""

import math
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from make_map import cells_of_map, grid_of
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal import esdf, read_cloud
from mapdeal.files.source import chunks_of
from mapdeal.maps.npz import write_npz
from mapdeal.sensors.points import read_points
from mapping import cast, walls

HERE = Path(__file__).parent
MAPDEAL = [sys.executable, "-m", "mapdeal"]
READINGS = 180


def rows(what: str, contenders: dict[str, Contender], runs: int) -> None:
    """Print a row for each contender, the first of which is mapdeal."""
    times = in_turns(contenders, runs)
    ours = next(iter(times.values()))
    for name, taken in times.items():
        ratios = ratio(ours, taken), ratio(ours, taken, "processor")
        row(what, name, f"{taken.median:.3f}", f"{np.median(taken.processor):.3f}", *ratios)


def readers(folder: Path, count: int) -> Any:
    """Yield names of files of points and clouds, and what reads them."""
    points = np.random.default_rng(0).uniform(-100, 100, (count, 3)).tolist()
    pcd = "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    heads = {
        "a.xyz": "",
        "a.pcd": f"{pcd}WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA ascii\n",
        "a.ply": f"ply\nformat ascii 1.0\nelement vertex {count}\n{axes}end_header\n",
        "a.csv": "x,y,z\n",
        "points.csv": "x,y\n",
    }
    for name, header in heads.items():
        path = folder / name
        mark = "," if name.endswith(".csv") else " "
        used = 2 if name == "points.csv" else 3
        told = repr if name == "a.csv" else "{:.6f}".format
        lines = (mark.join(map(told, numbers[:used])) for numbers in points)
        path.write_text(header + "\n".join(lines) + "\n")
        yield name, readers_of(path, mark, header.count("\n"))


def readers_of(path: Path, mark: str, skipped: int) -> dict[str, Contender]:
    def ours() -> np.ndarray:
        if path.name == "points.csv":
            return np.concatenate([part.numbers for part in read_points(chunks_of(path), path)])
        return read_cloud(path)

    def by_numpy() -> np.ndarray:
        return np.loadtxt(path, delimiter=mark, skiprows=skipped)

    def by_polars() -> pl.DataFrame:
        return pl.read_csv(path, separator=mark, has_header=False, skip_rows=skipped)

    assert np.array_equal(ours(), by_numpy())
    return {"mapdeal": ours, "numpy.loadtxt": by_numpy, "polars.read_csv": by_polars}


def queries(folder: Path, count: int) -> dict[str, Contender]:
    field = esdf(grid_of(cells_of_map(1000), (1.0, -2.0, 0.4)))
    source, points = folder / "field.npz", folder / "asked.csv"
    with source.open("wb") as file:
        write_npz(file, field)
    places = np.random.default_rng(0).uniform(0, 1000, (count, 2))
    lines = (f"{x:.6f},{y:.6f}\n" for x, y in field.frame.xy_from_continuous_rowcol(places))
    points.write_text("x,y\n" + "".join(lines))
    query = shlex.join([*MAPDEAL, "query", str(source), "--points", str(points)])
    peer = [str(HERE / "query_by_pandas.py"), str(source), str(points), str(folder / "peer.jsonl")]
    return {
        "mapdeal": ["sh", "-c", f"exec {query} > {folder}/ours.jsonl"],
        "pandas, map_coordinates, to_json": [sys.executable, *peer],
    }


def counting(folder: Path, count: int) -> dict[str, Contender]:
    """Return what makes a map of a CARMEN log, or counts its beams as a program in C++."""
    source, program = folder / "scans.log", folder / "count_beams"
    write_log(source, -(-count // READINGS))
    subprocess.run(["g++", "-O2", "-o", program, HERE / "count_beams.cpp"], check=True)
    output = ["-o", str(folder / "map.yaml"), "--method", "counting"]
    return {
        "mapdeal": [*MAPDEAL, "build", str(source), "-q", "--force", *output],
        "C++, -O2, which writes no map": [str(program), str(source), str(folder / "peer.pgm")],
    }


def write_log(path: Path, scans: int) -> None:
    """Write a log of scans in the hall of `mapping`."""
    turn = np.linspace(0, 40 * math.pi, scans, endpoint=False)
    poses = np.column_stack([5.6 + 4.2 * np.cos(turn), 4 + 2.4 * np.sin(turn), turn + 1.5])
    ranges = cast(poses, walls(), 0.01, np.radians(np.arange(READINGS) - 90.0)).ranges
    with path.open("w") as file:
        for k, (scan, pose) in enumerate(zip(ranges.tolist(), poses.tolist(), strict=True)):
            readings = " ".join(map("{:.2f}".format, scan))
            place, time = " ".join(map("{:.6f}".format, pose)), f"{k / 10:.6f}"
            file.write(f"FLASER {READINGS} {readings} {place} {place} {time} host {time}\n")


if __name__ == "__main__":
    given = options(__doc__, runs=9, rows=1_000_000)
    head("what", "contender", "seconds", "CPU seconds", "mapdeal to it", "in CPU time")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, contenders in readers(folder, given.rows):
            rows(f"reading {file}", contenders, given.runs)
        rows("query, text in, JSON lines out", queries(folder, given.rows), given.runs)
        rows("build --method counting", counting(folder, given.rows), given.runs)
        rows("start-up", {"mapdeal --version": [*MAPDEAL, "--version"]}, given.runs)
