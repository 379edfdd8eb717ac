"""Maps as pixels: many cells under one."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.grid.frame import Region
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.overlay import Pooling, Raster


@pytest.mark.parametrize("block_height", [1, 4, 7, 100])
def test_lazy_layers_are_pooled_without_more_than_a_block_of_rows(block_height):
    values = np.random.default_rng(3).normal(size=(53, 38)).astype(np.float32)
    values[5:9, 3:11] = np.nan
    asked = []

    def rows_of(rows):
        asked.append(rows.stop - rows.start)
        return values[rows]

    layer = lazy_layer(values.shape, np.float32, rows_of, block_height=block_height)
    for method, choose in (("largest", np.fmax), ("smallest", np.fmin)):
        expected = [
            [choose.reduce(values[row : row + 3, col : col + 3], axis=None)
             for col in range(0, 38, 3)]
            for row in range(0, 53, 3)
        ]  # fmt: skip
        found = getattr(Raster(reduce=3), method)(layer)
        assert np.array_equal(found, np.array(expected, np.float32), equal_nan=True)
    assert max(asked) <= max(3, block_height)  # a row of pixels has three of cells under it


@given(
    st.lists(st.integers(1, 52), max_size=9),
    st.sampled_from([None, Region(4, 3, 30, 21), Region(0, 0, 1, 38), Region(52, 0, 1, 1)]),
    st.integers(1, 9),
)
def test_rows_may_be_cut_anywhere_on_their_way_to_pixels(cuts, part, reduce):
    values = np.random.default_rng(4).integers(0, 99, (53, 38)).astype(np.int8)
    row, col, height, width = (0, 0, 53, 38) if part is None else part
    shown = values[row : row + height, col : col + width]
    expected = [
        [shown[y : y + reduce, x : x + reduce].max() for x in range(0, width, reduce)]
        for y in range(0, height, reduce)
    ]
    pooling = Pooling(Raster(reduce=reduce, part=part), values, np.fmax)
    for first, end in itertools.pairwise([0, *sorted(set(cuts)), 53]):
        pooling.take(slice(first, end))
    assert pooling.pixels.tolist() == expected
