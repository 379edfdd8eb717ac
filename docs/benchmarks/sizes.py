"""Time and peak memory of whole commands against the size of the map, as a table and a plot.

Run it as ``python docs/benchmarks/sizes.py [--sides 1000 2000 ... 30000] [--runs 3]
[--plot docs/images/sizes.png]``; it needs the extras ``bench`` and ``dev``, 6 GB of disk and, for
the largest sizes in memory, 12 GB of memory. Commands of a size take turns. Prints a table in
Markdown; fails on nothing.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from whole_process import measure

HERE = Path(__file__).parent
SIDES = [1000, 2000, 4000, 8000, 16000, 20000, 30000]
LARGEST_OF_PEER = 8000
SMALLEST_IN_BLOCKS = 16000
PLENTY = "1TB"


def commands(side: int, source: Path, output: Path, memory: str) -> dict[str, list[str]]:
    """Return what is measured at a size, by name."""
    mapdeal = [sys.executable, "-m", "mapdeal"]
    esdf = [*mapdeal, "esdf", str(source), "-o", str(output / "field.npy"), "-q", "--force"]
    run = [*mapdeal, "run", str(source), "-o", str(output), "-q", "--force"]
    made = {
        "esdf -o .npy": [*esdf, "--max-memory", PLENTY],
        "run": [*run, "--max-memory", PLENTY],
    }
    if side >= SMALLEST_IN_BLOCKS:
        made[f"esdf -o .npy, --max-memory {memory}"] = [*esdf, "--max-memory", memory]
        made[f"run, --max-memory {memory}"] = [*run, "--max-memory", memory]
    if side <= LARGEST_OF_PEER:
        peer = [sys.executable, str(HERE / "peer_script.py"), "opencv", str(source), str(output)]
        made["OpenCV script"] = peer
    return made


Results = dict[str, dict[int, tuple[float, float]]]


def plot(results: Results, path: Path) -> None:
    """Draw seconds and memory against size, a line for each command."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    colours = {"esdf": "tab:blue", "run": "tab:red", "OpenCV script": "tab:gray"}
    for name, by_side in results.items():
        sides = sorted(by_side)
        in_blocks = "--max-memory" in name
        style = {
            "color": colours[name if name in colours else name.split()[0].rstrip(",")],
            "linestyle": "--" if in_blocks else "-",
            "marker": "s" if in_blocks else "o",
            "markersize": 4,
            "label": name,
        }
        for axis, which in zip(axes, (0, 1), strict=True):
            axis.plot(sides, [by_side[side][which] for side in sides], **style)
    for axis, title in zip(axes, ("seconds", "peak memory, MiB"), strict=True):
        axis.set(xscale="log", yscale="log", xlabel="cells a side", title=title)
        axis.set_xticks(SIDES, [f"{side:,}" for side in SIDES], rotation=45)
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(alpha=0.3)
    axes[1].axhline(4096, color="black", linewidth=0.8)
    axes[1].annotate("4 GiB", (1000, 4096), xytext=(0, 3), textcoords="offset points")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", type=int, nargs="+", default=SIDES)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--max-memory", default="1GB")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    results: Results = {}
    print("| cells a side | command | seconds, median | min..max | peak MiB |")
    print("|---|---|---|---|---|")
    for side in options.sides:
        folder = Path(tempfile.mkdtemp(prefix="mapdeal-benchmark-"))
        # in a process of its own: what a child's peak is begins with what its parent's was
        subprocess.run([sys.executable, HERE / "make_map.py", str(side), folder / "map.yaml"])
        measured: dict[str, list[tuple[float, float]]] = {}
        for turn in range(options.runs + 1):
            for name, words in commands(
                side, folder / "map.yaml", folder / "out", options.max_memory
            ).items():
                (folder / "out").mkdir()
                result = measure(words)
                shutil.rmtree(folder / "out")
                if turn > 0 or options.runs == 1:  # the first turn warms the caches
                    measured.setdefault(name, []).append(result)
            if options.runs == 1:
                break
        shutil.rmtree(folder)
        for name, pairs in measured.items():
            seconds, peak = [s for s, _ in pairs], max(m for _, m in pairs)
            median = statistics.median(seconds)
            results.setdefault(name, {})[side] = (median, peak)
            spread = f"{min(seconds):.2f}..{max(seconds):.2f}"
            print(f"| {side} | {name} | {median:.2f} | {spread} | {peak:.0f} |", flush=True)
    if options.plot:
        plot(results, options.plot)


if __name__ == "__main__":
    main()
