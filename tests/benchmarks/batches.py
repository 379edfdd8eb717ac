"""Batches: jobs side by side against one, and one command against a loop of the shell.

Run it as ``python tests/benchmarks/batches.py [--runs 5] [--maps 200] [--jobs 2]``. Whole
processes take turns, A B A B, so that a drift of the machine's speed falls on both, and each
ratio is of two that stood beside each other. Prints a table in Markdown: medians. Fails on
nothing.
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

PROGRAM = f"{sys.executable} -m mapdeal run"
LARGE, SMALL = 1000, 384  # cells a side


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
        shutil.rmtree(folder / "large")
        make_maps(folder / "small", SMALL, options.maps)
        each = f"{PROGRAM} $map -q -o {folder}/out"
        compare(
            f"{options.maps} of {SMALL} x {SMALL}",
            {
                "a loop of the shell": f"for map in {folder}/small/*.yaml; do {each} || exit; done",
                "one `mapdeal run`": f"{PROGRAM} {folder}/small -q -o {folder}/out",
                "the same, `--jobs 1`": f"{PROGRAM} {folder}/small -q -o {folder}/out --jobs 1",
            },
            options,
            folder / "out",
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
            shutil.rmtree(out)
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
