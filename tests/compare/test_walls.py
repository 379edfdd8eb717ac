"""Walls of maps on coarser cells, which alignment looks at."""

import tracemalloc

import numpy as np
import pytest

from mapdeal.compare.walls import pooled


@pytest.mark.parametrize("shape", [(7, 11), (1, 9), (9, 1), (4, 8)])
@pytest.mark.parametrize("factor", [1, 3, 4, 20])
def test_pooled_counts_the_marked_cells_of_each_block(shape, factor):
    marked = np.random.default_rng(5).random(shape) < 0.4
    rows, cols = (range(0, side, factor) for side in shape)
    counts = [[marked[r : r + factor, c : c + factor].sum() for c in cols] for r in rows]
    np.testing.assert_array_equal(pooled(marked, factor), counts)


@pytest.mark.parametrize("shape", [(1, 100_000), (100_000, 1)])
def test_pooling_a_line_of_cells_takes_memory_for_its_cells_alone(shape):
    marked = np.ones(shape, np.bool_)
    tracemalloc.start()
    try:
        pooled(marked, 1000)  # squares of cells would be 100 MB
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 3 * marked.size
