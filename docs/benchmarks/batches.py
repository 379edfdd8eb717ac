"""Batches: jobs side by side against one, and one command against scripts, map by map.

Run it as ``python docs/benchmarks/batches.py [--runs 5] [--maps 200] [--jobs 2]``. Whole
processes take turns, A B A B, so that a drift of the machine's speed falls on both, and each
ratio is of two that stood beside each other. The script for one map is `peer_script.py`, run as
often at a time as there are jobs; lint stands beside a process that only reads the maps, with
Pillow and PyYAML. Prints a table in Markdown: medians. Fails on nothing.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from make_map import make_map

MAPDEAL = f"{sys.executable} -m mapdeal"
PROGRAM = f"{MAPDEAL} run"
PEER = Path(__file__).parent / "peer_script.py"
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


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--maps", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    print("| maps | contender | seconds, median | min..max | maps a second | ratio |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="mapdeal-benchmark-") as name:
        folder = Path(name)
        make_maps(folder / "large", LARGE, options.maps)
        one = f"{PROGRAM} {folder}/large -q --threads 1 -o {folder}/out"
        compare(
            f"{options.maps} of {LARGE} x {LARGE}",
            {
                "`--jobs 1 --threads 1`": f"{one} --jobs 1",
                f"`--jobs {options.jobs} --threads 1`": f"{one} --jobs {options.jobs}",
            },
            options,
            folder / "out",
        )
        compare_lint(folder / "large", LARGE, options)
        shutil.rmtree(folder / "large")
        make_maps(folder / "small", SMALL, options.maps)
        each = f"{PROGRAM} $map -q -o {folder}/out"
        peer = f"{sys.executable} {PEER} opencv {folder}/small/{{}}.yaml {folder}/out/{{}}"
        compare(
            f"{options.maps} of {SMALL} x {SMALL}",
            {
                "a loop of the shell": f"for map in {folder}/small/*.yaml; do {each} || exit; done",
                "one `mapdeal run`": (
                    f"{PROGRAM} {folder}/small -q -o {folder}/out --jobs {options.jobs}"
                ),
                "the same, `--jobs 1`": f"{PROGRAM} {folder}/small -q -o {folder}/out --jobs 1",
                f"OpenCV script, `xargs -P{options.jobs}`": (
                    f"basename -s .yaml -a {folder}/small/*.yaml"
                    f" | xargs -P{options.jobs} -I{{}} {peer}"
                ),
            },
            options,
            folder / "out",
        )
        compare_lint(folder / "small", SMALL, options)


def compare_lint(maps: Path, side: int, options: argparse.Namespace) -> None:
    """Print a row for lint of maps, and one for a script that reads them."""
    compare(
        f"{options.maps} of {side} x {side}",
        {
            "reading with Pillow and PyYAML": f"{sys.executable} -c '{READ_ALL}' {maps}",
            "`mapdeal lint`": f"{MAPDEAL} lint {maps} -q > {maps}.txt",
        },
        options,
        maps.parent / "out",
    )


def make_maps(folder: Path, side: int, count: int) -> None:
    """Write maps of one size, a copy each of one that is made."""
    folder.mkdir()
    make_map(side, folder / "000.yaml")
    yaml = (folder / "000.yaml").read_text()
    pixels = (folder / "000.pgm").read_bytes()
    for k in range(1, count):
        (folder / f"{k:03}.pgm").write_bytes(pixels)
        (folder / f"{k:03}.yaml").write_text(yaml.replace("000.pgm", f"{k:03}.pgm"))


def compare(
    what: str, contenders: dict[str, str], options: argparse.Namespace, out: Path
) -> None:  # fmt: skip
    """Print a row for each contender; ratios are how much faster it is than the first."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(options.runs):
        for name, line in contenders.items():
            started = time.perf_counter()
            subprocess.run(["sh", "-c", line], check=True)
            times[name].append(time.perf_counter() - started)
            shutil.rmtree(out, ignore_errors=True)  # lint makes none
    first = times[next(iter(contenders))]
    for name, seconds in times.items():
        ratio = statistics.median(a / b for a, b in zip(first, seconds, strict=True))
        median = statistics.median(seconds)
        print(
            f"| {what} | {name} | {median:.1f} | {min(seconds):.1f}..{max(seconds):.1f} | "
            f"{options.maps / median:.1f} | {ratio:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
