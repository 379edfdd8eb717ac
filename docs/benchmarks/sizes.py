"""Time and peak memory of whole commands against the size of the map, as a table and a plot.

Run it as ``python docs/benchmarks/sizes.py [--sides 1000 ... 30000] [--plot FILE.png]``; it needs
the extra ``dev``, too, 6 GB of disk and, for the largest sizes in memory, 12 GB of memory.
"""

import sys
import tempfile
from pathlib import Path

from turns import Contender, head, in_turns, options, row, write_map

PEER = Path(__file__).parent / "peer_script.py"
SIDES = [1000, 2000, 4000, 8000, 16000, 20000, 30000]
LARGEST_OF_PEER = 8000  # and of several turns
SMALLEST_IN_BLOCKS = 16000

Results = dict[str, dict[int, tuple[float, float]]]


def commands(side: int, source: Path, output: Path) -> dict[str, Contender]:
    mapdeal = [sys.executable, "-m", "mapdeal"]
    esdf = [*mapdeal, "esdf", str(source), "-o", str(output / "field.npy"), "-q", "--force"]
    run = [*mapdeal, "run", str(source), "-o", str(output), "-q", "--force"]
    made: dict[str, Contender] = {}
    for name, limit in (("", "1TB"), (", --max-memory 1GB", "1GB")):
        if not name or side >= SMALLEST_IN_BLOCKS:
            made[f"esdf -o .npy{name}"] = [*esdf, "--max-memory", limit]
            made[f"run{name}"] = [*run, "--max-memory", limit]
    if side <= LARGEST_OF_PEER:
        made["OpenCV script"] = [sys.executable, str(PEER), "opencv", str(source), str(output)]
    return made


def plot(results: Results, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    axes = figure.subplots(1, 2)
    colours = {"esdf": "tab:blue", "run": "tab:red", "OpenCV": "tab:gray"}
    for name, by_side in results.items():
        style = "s--" if "--max-memory" in name else "o-"
        colour = colours[name.replace(",", " ").split()[0]]
        for axis, measured in zip(axes, zip(*by_side.values(), strict=True), strict=True):
            axis.plot(list(by_side), measured, style, color=colour, markersize=4, label=name)
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


if __name__ == "__main__":
    given = options(__doc__, sides=SIDES, plot=None)
    results: Results = {}
    head("cells a side", "command", "seconds, median", "min..max", "peak MiB")
    for side in given.sides:
        with tempfile.TemporaryDirectory() as name:
            source = Path(name) / "map.yaml"
            write_map(side, source)
            (Path(name) / "out").mkdir()
            contenders = commands(side, source, Path(name) / "out")
            several = side <= LARGEST_OF_PEER
            times = in_turns(contenders, 3 if several else 1, warm_ups=int(several))
        for name, taken in times.items():
            peak = max(taken.mebibytes)
            results.setdefault(name, {})[side] = (taken.median, peak)
            row(side, name, f"{taken.median:.2f}", taken.spread, f"{peak:.0f}")
    if given.plot:
        plot(results, given.plot)
