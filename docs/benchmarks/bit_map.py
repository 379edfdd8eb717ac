"""Times of a bit map beside an array of bytes.

Run it as ``python docs/benchmarks/bit_map.py [--side 20000] [--runs 5]``.
"""

import numpy as np
from turns import head, in_turns, options, ratio, row

from mapdeal import BitMap

if __name__ == "__main__":
    given = options(__doc__, side=20_000, runs=5)
    rng = np.random.default_rng(0)
    mask = np.zeros((given.side, given.side), dtype=np.uint8)
    for row_, col in rng.integers(0, given.side, (2000, 2)):
        mask[row_ : row_ + 3, col : col + 400] = 1
        mask[row_ : row_ + 400, col : col + 3] = 1
    bits = BitMap.from_mask(mask, 0.05)
    cells = rng.integers(0, given.side, (1_000_000, 2))
    rows, cols = np.ascontiguousarray(cells.T)
    assert bits.count() == np.count_nonzero(mask)

    def set_bytes() -> None:
        copy = mask.copy()
        copy[rows, cols] = 1

    tasks = {
        "get a million cells": (lambda: bits.get(cells), lambda: mask[rows, cols] != 0),
        "get one cell": (lambda: bits.get([[5, 7]]), lambda: bool(mask[5, 7])),
        "set a million cells in a copy": (lambda: bits.set(cells), set_bytes),
        "count the ones": (bits.count, lambda: np.count_nonzero(mask)),
        "copy": (bits.copy, mask.copy),
    }
    print(f"{mask.nbytes / 1e6:.0f} MB of bytes, {bits.packed.nbytes / 1e6:.0f} MB of bits\n")
    head("task", "bits, ms", "bytes, ms", "ratio")
    for task, (ours, theirs) in tasks.items():
        one, other = in_turns({"bits": ours, "bytes": theirs}, given.runs).values()
        row(task, one.ms, other.ms, ratio(one, other))
    whole = {"unpack": bits.to_mask, "pack": lambda: BitMap.from_mask(mask, 0.05)}
    for name, times in in_turns(whole, given.runs).items():
        print(f"\n{name}: {times.median:.2f} s")
