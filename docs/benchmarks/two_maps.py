"""How well two maps of one place are aligned, and how exactly a map is scored.

Run it as ``python docs/benchmarks/two_maps.py DATA``, the folder with recorded values and maps
(docs/test_data.md). A script of the data makes 42 pairs of maps of one place, whose relative pose
is known exactly, and 6 pairs of different places. What other programs make of them, and their
scores of four other pairs, is recorded beside the truth.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from turns import head, row

from mapdeal import OccupancyGrid, read_map
from mapdeal.compare.align import placed
from mapdeal.compare.score import compare_to_truth
from mapdeal.grid.frame import Transform

PEERS = {"orb": "OpenCV, ORB and RANSAC", "akaze": "OpenCV, AKAZE and RANSAC",
         "ecc_centroid": "OpenCV, ECC", "logpolar": "scikit-image, log-polar"}  # fmt: skip


def alignments(data: Path, generated: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of all pairs, under the names of the recorded ones."""
    kinds, refused, seconds = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        words = [data / generated["script"], folder, "--seed", str(generated["seed"])]
        subprocess.run([sys.executable, *words], check=True, capture_output=True)
        for pair in generated["pairs"]:
            first, second = (read_map(Path(folder) / pair[which]) for which in "ab")
            started = time.perf_counter()
            found = placed(first, second)
            seconds.append(time.perf_counter() - started)
            if pair["truth"] is None:
                refused.append(not found.same_place)
            else:
                right = is_right(first, found.transform, pair["truth"])
                kinds.append(right if found.same_place else None)
    return {
        "pairs": len(kinds),
        "right": kinds.count(True),
        "wrong_but_confident": kinds.count(False),
        "refused": kinds.count(None),
        "negatives": len(refused),
        "negatives_refused": sum(refused),
        "median_s": statistics.median(seconds),
        "max_s": max(seconds),
    }


def is_right(first: OccupancyGrid, found: Transform, truth: dict[str, float]) -> bool:
    """Return whether the walls are shifted by at most 0.5 m on average, and turned by 2 degrees."""
    wanted = Transform(truth["dx"], truth["dy"], math.radians(truth["dtheta_deg"]))
    walls = first.frame.xy_from_rowcol(np.argwhere(first.occupied()))
    shift = np.hypot(*(found.points(walls) - wanted.points(walls)).T).mean()
    turn = math.degrees(math.remainder(found.yaw - wanted.yaw, math.tau))
    return bool(shift <= 0.5 and abs(turn) <= 2)


def told(figures: dict[str, Any]) -> list[str]:
    return [
        f"{figures['right']} of {figures['pairs']}", str(figures["wrong_but_confident"]),
        str(figures["refused"]), f"{figures['negatives_refused']} of {figures['negatives']}",
        f"{figures['median_s']:.2f}", f"{figures['max_s']:.2f}",
    ]  # fmt: skip


def print_scores(data: Path) -> None:
    """Print how far scores are from those that other libraries have found."""
    apart: dict[str, list[float]] = {}
    for pair in json.loads((data / "expected" / "score.json").read_text())["pairs"]:
        files = (data / pair["lattice"][which]["file"] for which in ("est", "truth"))
        found = compare_to_truth(*(grid_of(file, pair["resolution"]) for file in files)).values
        for kind, difference in differences(found, pair["values"]):
            apart.setdefault(kind, []).append(difference)
    head("kind of value", "values", "largest difference")
    for kind, some in apart.items():
        row(kind, len(some), f"{max(some):.2g}")


def differences(found: Any, recorded: Any, kind: str = "other") -> Iterator[tuple[str, float]]:
    if isinstance(recorded, dict):
        for name, value in recorded.items():
            inner = "similarity" if name.startswith("ssim") else kind
            yield from differences(found[name], value, inner)
    else:
        yield kind, np.abs(np.subtract(found, recorded)).max()


def grid_of(path: Path, resolution: float) -> OccupancyGrid:
    """Return the map of a picture: 0 occupied, 205 unknown, 254 free."""
    table = np.zeros(256, np.int8)
    table[[0, 205]] = 100, -1
    return OccupancyGrid(table[np.asarray(Image.open(path))[::-1]], resolution)


if __name__ == "__main__":
    data = Path(sys.argv[1])
    recorded = json.loads((data / "expected" / "align.json").read_text())
    head("contender", "right", "wrong, but confident", "refused", "negatives refused",
         "seconds, median", "max")  # fmt: skip
    row("mapdeal", *told(alignments(data, recorded["generated"])))
    for peer, name in PEERS.items():
        row(name, *told(recorded["peers"]["generated"][peer]))
    print()
    print_scores(data)
