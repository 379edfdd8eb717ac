"""How well two maps of one place are aligned, and how exactly a map is scored.

Run it as ``python docs/benchmarks/two_maps.py [DATA] [--only align|score] [--each]``. DATA is the
folder with recorded values and maps (docs/test_data.md), by default the one that the environment
variable MAPDEAL_TEST_DATA names. A script of the data makes 42 pairs of maps of one place, whose
relative pose is known exactly, and 6 pairs of different places; 3 pairs of the same office floor
are real. What other programs make of them is recorded beside the truth. Prints tables in Markdown;
``--each`` prints every pair, too. Fails on nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from mapdeal import OccupancyGrid, read_map
from mapdeal.compare.score import compare_to_truth
from mapdeal.grid.frame import Transform

RIGHT, FINE = (0.5, 2.0), (0.1, 0.3)
"""Mean shift of the walls in metres, and degrees."""

TOLERANCES = {
    "similarity (ssim), absolute": 1e-6,
    "distances, relative": 1e-9,
    "ratios, absolute": 1e-12,
    "counts": 0.0,
}

Values = dict[str, Any]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--only", choices=("align", "score"))
    parser.add_argument("--each", action="store_true")
    options = parser.parse_args()
    data = options.data or Path(os.environ["MAPDEAL_TEST_DATA"])
    if options.only != "score":
        print_alignments(data, each=options.each)
    if options.only != "align":
        print_scores(data)


class Pair(NamedTuple):
    """Two maps, and where the second lies, None if they are of different places."""

    name: str
    first: Path
    second: Path
    truth: Transform | None


class Outcome(NamedTuple):
    """What came of a pair."""

    pair: Pair
    same_place: bool
    shift: float
    degrees: float
    seconds: float
    processor: float

    @property
    def kind(self) -> str:
        """One of fine, right, wrong, refused."""
        if not self.same_place:
            return "refused"
        error = (self.shift, self.degrees)
        within = [all(np.array(error) <= limit) for limit in (FINE, RIGHT)]
        return "fine" if within[0] else "right" if within[1] else "wrong"


def print_alignments(data: Path, *, each: bool) -> None:
    """Print how many pairs are aligned, beside the recorded peers."""
    recorded = json.loads((data / "expected" / "align.json").read_text())
    with tempfile.TemporaryDirectory(prefix="mapdeal-pairs-") as folder:
        made = [outcome(pair) for pair in generated_pairs(data, recorded, Path(folder))]
    stored = [outcome(pair) for pair in real_pairs(data, recorded)]
    titles = {"generated": "42 generated pairs, 6 negatives", "tmcl": "3 real pairs (tmcl)"}
    for (name, title), found in zip(titles.items(), (made, stored), strict=True):
        print(f"\n{title}\n")
        print(
            "| contender | right | fine | wrong, but confident | refused | negatives refused "
            "| seconds, median | max |"
        )
        print("|---" * 8 + "|")
        print(row("mapdeal", summary(found)))
        for peer, figures in recorded["peers"][name].items():
            print(row(peer, figures))
        processor = [one.processor for one in found]
        print(
            f"\nmapdeal's processor time: {statistics.median(processor):.2f} s, "
            f"at most {max(processor):.2f} s"
        )
        for one in found if each else ():
            print(
                f"{one.pair.name}: {one.kind}, {one.shift:.4f} m, {one.degrees:.4f} deg, "
                f"{one.seconds:.2f} s"
            )


def generated_pairs(data: Path, recorded: Values, folder: Path) -> Iterator[Pair]:
    """Make the pairs in a folder."""
    listed = recorded["generated"]
    script = [sys.executable, str(data / listed["script"]), str(folder)]
    subprocess.run([*script, "--seed", str(listed["seed"])], check=True, capture_output=True)
    for one in listed["pairs"]:
        yield Pair(one["id"], folder / one["a"], folder / one["b"], transform_of(one["truth"]))


def real_pairs(data: Path, recorded: Values) -> Iterator[Pair]:
    """Yield the pairs of stored maps."""
    for one in recorded["real"]:
        yield Pair(one["id"], data / one["a"], data / one["b"], transform_of(one["truth"]))


def transform_of(truth: Values | None) -> Transform | None:
    """Return a recorded pose: p_second = R p_first + (dx, dy)."""
    if truth is None:
        return None
    return Transform(truth["dx"], truth["dy"], math.radians(truth["dtheta_deg"]))


def outcome(pair: Pair) -> Outcome:
    """Align a pair; the time is without that of reading the maps."""
    from mapdeal.compare.align import placed as align

    first, second = read_map(pair.first), read_map(pair.second)
    started, used = time.perf_counter(), time.process_time()
    found = align(first, second)
    times = (time.perf_counter() - started, time.process_time() - used)
    if pair.truth is None:
        return Outcome(pair, found.same_place, math.inf, math.inf, *times)
    points = first.frame.xy_from_rowcol(np.argwhere(first.occupied()))
    apart = found.transform.points(points) - pair.truth.points(points)
    turn = math.remainder(found.transform.yaw - pair.truth.yaw, math.tau)
    shift = float(np.hypot(*apart.T).mean())
    return Outcome(pair, found.same_place, shift, abs(math.degrees(turn)), *times)


def summary(found: Sequence[Outcome]) -> Values:
    """Return the figures of several pairs, under the names of the recorded ones."""
    kinds = [one.kind for one in found if one.pair.truth is not None]
    negatives = [one for one in found if one.pair.truth is None]
    seconds = [one.seconds for one in found]
    return {
        "pairs": len(kinds),
        "right": kinds.count("right") + kinds.count("fine"),
        "fine": kinds.count("fine"),
        "wrong_but_confident": kinds.count("wrong"),
        "refused": kinds.count("refused"),
        "negatives": len(negatives),
        "negatives_refused": sum(not one.same_place for one in negatives),
        "median_s": statistics.median(seconds),
        "max_s": max(seconds),
    }


def row(name: str, figures: Values) -> str:
    """Return a row of the table of alignments."""
    pairs, negatives = figures["pairs"], figures["negatives"]
    refused = f"{figures['negatives_refused']} of {negatives}" if negatives else "-"
    cells = [
        f"{figures['right']} of {pairs}", f"{figures['fine']}", f"{figures['wrong_but_confident']}",
        f"{figures['refused']}", refused, f"{figures['median_s']:.2f}", f"{figures['max_s']:.2f}",
    ]  # fmt: skip
    return f"| {name} | {' | '.join(cells)} |"


def print_scores(data: Path) -> None:
    """Print every recorded value as it is found, and the largest differences by kind."""
    pairs = json.loads((data / "expected" / "score.json").read_text())["pairs"]
    recorded = [flat(pair["values"]) for pair in pairs]
    found = [flat(score(data, pair)) for pair in pairs]
    print(f"\n| value | {' | '.join(pair['id'] for pair in pairs)} |")
    print("|---" * (len(pairs) + 1) + "|")
    for name in recorded[0]:
        cells = [
            told(name, *(one[name] for one in both)) for both in zip(found, recorded, strict=True)
        ]
        print(f"| {name} | {' | '.join(cells)} |")
    print("\n| kind of value | values | largest difference | tolerance |")
    print("|---|---|---|---|")
    for kind, tolerance in TOLERANCES.items():
        differences = [
            difference(name, values[name], expected)
            for values, wanted in zip(found, recorded, strict=True)
            for name, expected in wanted.items()
            if kind_of(name, expected) == kind
        ]
        print(f"| {kind} | {len(differences)} | {max(differences):.2g} | {tolerance:g} |")


def score(data: Path, pair: Values) -> Values:
    """Return the values of a pair of stored pictures, which lie on one lattice."""
    estimate, truth = (
        grid_of(data / pair["lattice"][which]["file"], pair["resolution"])
        for which in ("est", "truth")
    )
    return compare_to_truth(estimate, truth).values


def grid_of(path: Path, resolution: float) -> OccupancyGrid:
    """Return the map of a picture: 0 occupied, 205 unknown, 254 free."""
    table = np.zeros(256, np.int8)
    table[[0, 205]] = 100, -1
    return OccupancyGrid(table[np.asarray(Image.open(path))[::-1]], resolution)


def flat(values: Values, before: str = "") -> Values:
    """Return nested values by dotted names, of a list each of its numbers."""
    found: Values = {}
    for name, value in values.items():
        if isinstance(value, list):
            value = dict(enumerate(value))
        if isinstance(value, dict):
            found |= flat(value, f"{before}{name}.")
        else:
            found[f"{before}{name}"] = value
    return found


def kind_of(name: str, recorded: float) -> str:
    """Return the kind of a value, for which there is a tolerance."""
    similarity, distances, ratios, counts = TOLERANCES
    if isinstance(recorded, int):
        return counts
    if name.startswith("ssim"):
        return similarity
    return distances if "_m." in name and ".share" not in name else ratios


def difference(name: str, found: float, recorded: float) -> float:
    """Return how far a value is from the recorded one, in the terms of its tolerance."""
    apart = abs(found - recorded)
    if kind_of(name, recorded).endswith("relative"):
        return apart / abs(recorded) if recorded else apart
    return apart


def told(name: str, found: float, recorded: float) -> str:
    """Return a value, with the recorded one if they differ by more than the tolerance."""
    text = str(found) if isinstance(recorded, int) else f"{found:.7g}"
    if difference(name, found, recorded) <= TOLERANCES[kind_of(name, recorded)]:
        return text
    return f"**{text}, recorded {recorded:.7g}**"


if __name__ == "__main__":
    main()
