"""Kill runs at random moments, and check the files that remain.

Run it as ``python tests/robustness/kill_runs.py [--kills 200]``. Each time a folder with the
outputs of one run is written over by another run, which is killed (SIGKILL). Every file must be
that of the old or of the new run; a set of both must be found by ``lint``, and by it alone; and
then a run must go on and clean up. Prints the outcomes; exits with 1 if there is a problem.
"""

import argparse
import hashlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from mapdeal import OccupancyGrid, write_map

OLD, NEW = ["--set", "inflate.radius=0.1"], ["--set", "inflate.radius=0.3"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        occupancy = (np.random.default_rng(0).random((700, 900)) < 0.02).astype(np.int8) * 100
        write_map(folder / "m.yaml", OccupancyGrid(occupancy, 0.05, (1.0, -2.0, 0.4)))
        found, problems = kill_all(folder, options.kills)
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(found.items()))
    print(f"{options.kills} kills left sets that are: {counts}; {len(problems)} problems")
    for problem in problems:
        print(f"problem: {problem}")
    return bool(problems)


def kill_all(folder, kills):
    started = time.perf_counter()
    run_process(command(folder, "new", NEW)).check_returncode()
    duration = time.perf_counter() - started
    run_process(command(folder, "old", OLD)).check_returncode()
    sums = {which: sums_of(folder / which / "m") for which in ("old", "new")}
    moments = random.Random(1)
    found, problems = Counter(), []
    for kill in range(kills):
        shutil.rmtree(folder / "out", ignore_errors=True)
        shutil.copytree(folder / "old", folder / "out")
        words = command(folder, "out", [*NEW, "--force"])
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        # files are renamed in a short moment at the end: half of the kills are sent around it
        time.sleep(moments.uniform(0.0 if kill % 2 else 0.85, 1.05) * duration)
        process.send_signal(signal.SIGKILL)
        process.wait()
        kind, problems_of_set = judge(folder, sums)
        found[kind] += 1
        problems += [f"kill {kill}: {problem}" for problem in problems_of_set]
    return found, problems


def judge(folder, sums):
    """Return the kind of a set, and the problems of its files and of the commands after it."""
    remaining = folder / "out" / "m"
    kind, problems = kind_of(remaining, sums)
    lint = run_process([sys.executable, "-m", "mapdeal", "lint", str(remaining)])
    if (lint.returncode == 1) != (kind == "mixed"):
        problems.append(f"lint of a set that is {kind}: {lint.stdout}{lint.stderr}")
    again = run_process(command(folder, "out", [*NEW, *([] if kind == "new" else ["--force"])]))
    if again.returncode or ("unchanged" in again.stdout) != (kind == "new"):
        problems.append(f"the next run over a set that is {kind}: {again.stdout}{again.stderr}")
    # a run that is up to date writes nothing and leaves temporary files
    if kind != "new" and list(remaining.glob(".mapdeal-*")):
        problems.append("the next run leaves temporary files")
    if sums_of(remaining) != sums["new"]:
        problems.append("the next run does not leave its own files alone")
    return kind, problems


def kind_of(remaining, sums):
    """Return whether a set is old, new or mixed, and the problems of its files."""
    old, new = (set(sums[which].items()) for which in ("old", "new"))
    found = set(sums_of(remaining).items())
    kinds = [which for which, own in (("old", old - new), ("new", new - old)) if found & own]
    problems = [f"{name} is torn" for name, _ in found - old - new]
    problems += [f"{name} is gone" for name in sums["old"].keys() - sums_of(remaining)]
    return "mixed" if len(kinds) == 2 else [*kinds, "old"][0], problems


def run_process(words):
    return subprocess.run(words, capture_output=True, text=True, check=False)


def command(folder, out, words):
    start = [sys.executable, "-m", "mapdeal", "run", str(folder / "m.yaml")]
    return [*start, "-o", str(folder / out), *words]


def sums_of(folder):
    """Return the checksums of files by their names, but of temporary ones."""
    paths = [path for path in folder.iterdir() if not path.name.startswith(".mapdeal-")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


if __name__ == "__main__":
    sys.exit(main())
