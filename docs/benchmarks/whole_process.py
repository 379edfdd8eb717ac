"""Time and peak memory of ``mapdeal run`` beside the hand-written scripts, as whole processes.

Run it as ``python docs/benchmarks/whole_process.py [--sides 384 2000 4000] [--runs 5]``, below
``taskset -c 0`` for one core.
"""

import sys
import tempfile
from pathlib import Path

from turns import head, in_turns, options, ratio, row, write_map

PEER = Path(__file__).parent / "peer_script.py"


def commands(source: Path, folder: Path) -> dict[str, list[str]]:
    run = [sys.executable, "-m", "mapdeal", "run", str(source), "-q", "--force"]
    peer = [sys.executable, str(PEER)]
    return {
        "mapdeal run --image-max 0": [*run, "--image-max", "0", "-o", str(folder / "a")],
        "OpenCV script": [*peer, "opencv", str(source), str(folder / "b")],
        "scipy script": [*peer, "scipy", str(source), str(folder / "c")],
    }


if __name__ == "__main__":
    given = options(__doc__, sides=[384, 2000, 4000], runs=5)
    head("cells a side", "command", "seconds, median", "min..max", "peak MiB", "to OpenCV")
    for side in given.sides:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_map(side, folder / "map.yaml")
            times = in_turns(commands(folder / "map.yaml", folder), given.runs)
        for command, taken in times.items():
            peak, to_opencv = max(taken.mebibytes), ratio(taken, times["OpenCV script"])
            row(side, command, f"{taken.median:.2f}", taken.spread, f"{peak:.0f}", to_opencv)
