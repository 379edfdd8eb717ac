"""Batches: jobs side by side against one, and one command against scripts, map by map.

Run it as ``python docs/benchmarks/batches.py [--runs 5] [--maps 200] [--jobs 2]``. The script for
one map is `peer_script.py`, run as often at a time as there are jobs; lint stands beside a process
that only reads the maps, with Pillow and PyYAML. Ratios are to the first of a group. The CPU time
of workers is not counted.
"""

import shutil
import statistics
import sys
import tempfile
from pathlib import Path

from make_map import make_map
from turns import Contender, head, in_turns, options, ratio, row

MAPDEAL = f"{sys.executable} -m mapdeal"
PEER = f"{sys.executable} {Path(__file__).parent / 'peer_script.py'}"
LARGE, SMALL = 1000, 384  # cells a side
READ_ALL = """
import sys
from pathlib import Path
import numpy as np
import yaml
from PIL import Image
for path in sorted(Path(sys.argv[1]).glob("*.yaml")):
    about = yaml.safe_load(path.read_text())
    np.asarray(Image.open(path.parent / about["image"]).convert("L"))
"""


def make_maps(folder: Path, side: int, count: int) -> None:
    """Write maps of one size, a copy each of one that is made."""
    folder.mkdir()
    make_map(side, folder / "000.yaml")
    yaml = (folder / "000.yaml").read_text()
    for k in range(1, count):
        shutil.copy(folder / "000.pgm", folder / f"{k:03}.pgm")
        (folder / f"{k:03}.yaml").write_text(yaml.replace("000.pgm", f"{k:03}.pgm"))


def groups(maps: Path, out: Path, side: int, jobs: int) -> list[dict[str, str]]:
    """Return what is compared on maps of a size, as lines of the shell."""
    run = f"{MAPDEAL} run {maps} -q -o {out}"
    if side == LARGE:
        return [{f"`--jobs {n} --threads 1`": f"{run} --threads 1 --jobs {n}" for n in (1, jobs)}]
    each = f"{MAPDEAL} run $map -q -o {out}"
    peer = f"xargs -P{jobs} -I{{}} {PEER} opencv {maps}/{{}}.yaml {out}/{{}}"
    return [
        {
            "a loop of the shell": f"for map in {maps}/*.yaml; do {each} || exit; done",
            "one `mapdeal run`": f"{run} --jobs {jobs}",
            "the same, `--jobs 1`": f"{run} --jobs 1",
            f"OpenCV script, `xargs -P{jobs}`": f"basename -s .yaml -a {maps}/*.yaml | {peer}",
        },
        {
            "reading with Pillow and PyYAML": f"{sys.executable} -c '{READ_ALL}' {maps}",
            "`mapdeal lint`": f"{MAPDEAL} lint {maps} -q",
        },
    ]


if __name__ == "__main__":
    given = options(__doc__, runs=5, maps=200, jobs=2)
    head(
        "maps", "contender", "seconds, median", "min..max", "CPU seconds", "maps a second", "ratio"
    )
    for side in (LARGE, SMALL):
        with tempfile.TemporaryDirectory() as name:
            maps, out = Path(name) / "maps", Path(name) / "out"
            make_maps(maps, side, given.maps)
            for lines in groups(maps, out, side, given.jobs):
                contenders: dict[str, Contender] = {a: ["sh", "-c", b] for a, b in lines.items()}
                times = in_turns(contenders, given.runs, clear=str(out))
                first = next(iter(times.values()))
                for contender, taken in times.items():
                    row(f"{given.maps} of {side} x {side}", contender, f"{taken.median:.2f}",
                        taken.spread, f"{statistics.median(taken.processor):.2f}",
                        f"{given.maps / taken.median:.1f}", ratio(first, taken))  # fmt: skip
