"""Local maps a second, from files to files, beside a hand-written loop on OpenCV.

Run it as ``python docs/benchmarks/local_maps.py [--runs 3] [--clouds 60]``. Clouds of 70,000 points
in binary PCD; whole processes.
"""

import math
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from turns import Contender, head, in_turns, options, ratio, row

POINTS = 70_000
HEADER = (
    "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
    f"WIDTH {POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\nDATA binary\n"
)
BY_HAND = Path(__file__).parent / "local_maps_by_hand.py"


def contenders(folder: Path) -> dict[str, Contender]:
    clouds, poses = str(folder / "clouds"), str(folder / "poses.txt")
    local = ["-m", "mapdeal", "local", "-q", "--size", "8.0,8.0"]
    local += ["--cloud", clouds, "--poses", poses]

    listed = {
        "`mapdeal local --no-images`": [*local, "--no-images", "-o"],
        "the same, `--threads 1`": [*local, "--no-images", "--threads", "1", "-o"],
        "rolling, `--keep 10 --no-images`": [*local, "--keep", "10", "--no-images", "-o"],
        "`mapdeal local`, with pictures": [*local, "-o"],
        "hand-written loop, no pictures": [str(BY_HAND), clouds, poses],
    }

    def run(words: list[str]) -> None:
        # never the same folder: file systems make files slowly where some were removed
        out = f"{tempfile.mkdtemp(dir=folder)}/out"
        subprocess.run([sys.executable, *words, out], check=True)

    return {name: partial(run, words) for name, words in listed.items()}


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
        columns = (distance * np.cos(angle), distance * np.sin(angle), height, height)
        points = np.stack(columns, axis=1).astype("<f4").tobytes()
        (folder / "clouds" / f"{k}.pcd").write_bytes(HEADER.encode() + points)
        lines.append(f"{0.02 * k:.2f} {-0.01 * k:.2f} {0.01 * k:.2f}")
    (folder / "poses.txt").write_text("\n".join(lines))


if __name__ == "__main__":
    given = options(__doc__, runs=3, clouds=60)
    with tempfile.TemporaryDirectory() as name:
        make_clouds(Path(name), given.clouds)
        times = in_turns(contenders(Path(name)), given.runs)
    *_, loop = times.values()
    head("contender", "maps a second", "milliseconds a map", "to the loop")
    for name, taken in times.items():
        each = taken.median / given.clouds
        row(name, f"{1 / each:.1f}", f"{1000 * each:.1f}", ratio(taken, loop))
