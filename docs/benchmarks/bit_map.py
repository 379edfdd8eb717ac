"""Measure the bit map against a grid of bytes: memory, access, and the way to disk.

Run it as ``python docs/benchmarks/bit_map.py --side 20000``.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mapdeal import BitMap, read_bit_map, write_bit_map

TURNS = 5


def seconds(work: Callable[[], object]) -> float:
    """Return the median time of a piece of work, after a warm-up."""
    work()
    times = []
    for _ in range(TURNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=20_000)
    side = parser.parse_args().side
    rng = np.random.default_rng(0)
    mask = np.zeros((side, side), dtype=np.uint8)
    for _ in range(2000):
        row, col = rng.integers(0, side, 2)
        mask[row : row + 3, col : col + 400] = 1
        mask[row : row + 400, col : col + 3] = 1
    bits = BitMap.from_mask(mask, 0.05)
    cells = rng.integers(0, side, (1_000_000, 2))
    rows, cols = cells[:, 0].copy(), cells[:, 1].copy()
    print(f"{side} x {side} cells: {mask.nbytes / 1e6:.0f} MB of bytes, "
          f"{bits.packed.nbytes / 1e6:.0f} MB of bits")  # fmt: skip
    print("| task | bits, ms | bytes, ms | ratio |\n|---|---|---|---|")
    row = lambda name, a, b: print(f"| {name} | {1e3 * a:.3g} | {1e3 * b:.3g} | {a / b:.2f} |")  # noqa: E731
    row("get a million cells", seconds(lambda: bits.get(cells)),
        seconds(lambda: mask[rows, cols] != 0))  # fmt: skip
    row("get one cell", seconds(lambda: bits.get([[5, 7]])),
        seconds(lambda: bool(mask[5, 7])))  # fmt: skip

    def set_bytes() -> None:
        copy = mask.copy()
        copy[rows, cols] = 1

    row("set a million cells in a copy", seconds(lambda: bits.set(cells)), seconds(set_bytes))
    row("count the ones", seconds(bits.count), seconds(lambda: np.count_nonzero(mask)))
    row("copy", seconds(bits.copy), seconds(mask.copy))
    print(f"\npack {seconds(lambda: BitMap.from_mask(mask, 0.05)):.2f} s, "
          f"unpack {seconds(bits.to_mask):.2f} s")  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.pbm"
        print(f"write {seconds(lambda: write_bit_map(path, bits, force=True)):.2f} s, "
              f"read {seconds(lambda: read_bit_map(path)):.2f} s")  # fmt: skip
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak of this process {peak:.0f} MiB")


if __name__ == "__main__":
    main()
