"""Time and peak memory of ``mapdeal run`` beside the hand-written scripts, as whole processes.

Run it as ``python docs/benchmarks/whole_process.py [--sides 384 2000 4000] [--runs 5]``; it
needs the extra ``bench``. Each row's commands take turns, A B C A B C, so that a drift of the
machine's speed falls on all of them. Prints a table in Markdown; fails on nothing.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from make_map import make_map

HERE = Path(__file__).parent


def commands(source: Path, folder: Path) -> dict[str, list[str]]:
    """Return what is compared, by name."""
    peer = [sys.executable, str(HERE / "peer_script.py")]
    run = [sys.executable, "-m", "mapdeal", "run", str(source), "-q", "--force"]
    full_size = ["--image-max", "0"]
    return {
        "mapdeal run": [*run, "-o", str(folder / "a")],
        "mapdeal run --image-max 0": [*run, *full_size, "-o", str(folder / "b")],
        "OpenCV script": [*peer, "opencv", str(source), str(folder / "c")],
        "scipy script": [*peer, "scipy", str(source), str(folder / "d")],
    }


def measure(words: list[str]) -> tuple[float, float]:
    """Run a command; return its seconds and its peak memory in MiB."""
    # Compiled bytecode is kept, as in any installation.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    started = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{words} ended with {process.returncode}")
    return seconds, usage.ru_maxrss / 1024


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", type=int, nargs="+", default=[384, 2000, 4000])
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="mapdeal-benchmark-"))
    print("| cells a side | command | seconds, median | min..max | peak MiB | to OpenCV |")
    print("|---|---|---|---|---|---|")
    for side in options.sides:
        make_map(side, folder / "map.yaml")
        compared = commands(folder / "map.yaml", folder)
        results: dict[str, list[tuple[float, float]]] = {name: [] for name in compared}
        for turn in range(options.runs + 1):
            for name, words in compared.items():
                result = measure(words)
                if turn > 0:  # the first turn warms the caches
                    results[name].append(result)
        reference = results["OpenCV script"]
        for name, pairs in results.items():
            seconds = [s for s, _ in pairs]
            ratio = statistics.median(
                a / b for (a, _), (b, _) in zip(pairs, reference, strict=True)
            )
            peak = max(m for _, m in pairs)
            print(
                f"| {side} | {name} | {statistics.median(seconds):.2f} | "
                f"{min(seconds):.2f}..{max(seconds):.2f} | {peak:.0f} | {ratio:.2f} |",
                flush=True,
            )
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
