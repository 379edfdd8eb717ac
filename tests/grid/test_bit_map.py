"""The bit map against a plain array of bool."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import BitMap, OccupancyGrid
from strategies import masks

PLACE = (0.25, (1.5, -2.0, 0.4))


@given(masks(35))
def test_the_way_there_and_back(mask):
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.shape == mask.shape
    assert np.array_equal(bits.to_mask(), mask)
    assert np.array_equal(bits.to_occupancy().occupancy, mask * np.int8(100))
    assert np.array_equal(BitMap.from_occupancy(bits.to_occupancy()).packed, bits.packed)
    assert bits.count() == mask.sum()
    assert bits.frame == OccupancyGrid(mask * np.int8(100), *PLACE).frame
    # every bit is where the document says, and the others are 0, whatever is given
    packed = bits.packed
    assert packed.shape == (mask.shape[0], -(-mask.shape[1] // 8))
    for row, col in np.ndindex(mask.shape):
        assert (packed[row, col // 8] >> (7 - col % 8)) & 1 == mask[row, col]
    full = np.packbits(np.ones(mask.shape, bool), axis=1)
    assert not (packed & ~full).any()
    assert np.array_equal(bits.fill().packed, full)
    assert not bits.fill(False).packed.any()
    all_set = np.full(packed.shape, 0xFF, np.uint8)
    assert np.array_equal(BitMap(all_set, mask.shape[1], *PLACE).packed, full)
    assert (all_set == 0xFF).all()


@given(masks(35), st.data())
def test_get_and_set_of_many_cells(mask, data):
    height, width = mask.shape
    cell = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    cells = data.draw(st.lists(cell, max_size=20))
    value = data.draw(st.booleans())
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.get(cells).tolist() == [mask[cell] for cell in cells]
    beyond = [(height, 0), (0, width), (-1, 0)]
    assert bits.contains([*cells, *beyond]).tolist() == [True] * len(cells) + [False] * 3
    expected = mask.copy()
    for cell in cells:
        expected[cell] = value
    assert np.array_equal(bits.set(cells, value).to_mask(), expected)
    assert np.array_equal(bits.to_mask(), mask)


@pytest.mark.parametrize(("bits", "expected"), [
    (BitMap.from_mask([[-1, 0, 1, 100]], *PLACE), [0, 0, 1, 1]),
    (BitMap.from_mask(np.array([[0, 1, 254, 255]], np.uint8), *PLACE), [0, 1, 1, 1]),
    (BitMap.from_mask([[0.0, 0.2, -0.5, math.inf]], *PLACE), [0, 1, 0, 1]),
    (BitMap.from_occupancy(OccupancyGrid([[-1, 64, 65, 100]], *PLACE)), [0, 0, 0, 1]),
    (
        BitMap.from_occupancy(OccupancyGrid([[-1, 64, 65, 100]], *PLACE), lethal_threshold=65),
        [0, 0, 1, 1],
    ),
])  # fmt: skip
def test_any_value_above_0_or_up_to_a_threshold_is_a_1(bits, expected):
    assert bits.to_mask()[0].tolist() == expected


def test_cells_are_cleared_by_shapes_and_never_in_place():
    bits = BitMap.from_mask(np.ones((5, 11)), *PLACE)
    ends = bits.frame.xy_from_rowcol([[1, 2], [1, 8]])
    assert bits.line(ends, value=False).count() == 55 - 7
    assert bits.circle(tuple(ends[0]), 0.0, value=False).count() == 55 - 1
    copy = bits.copy()
    assert not np.shares_memory(bits.packed, copy.packed)
    assert (np.array_equal(bits.packed, copy.packed), copy.frame) == (True, bits.frame)
    with pytest.raises(ValueError, match="read-only"):
        bits.packed[0, 0] = 0


def test_figures_of_a_bit_map_count_its_cells_and_not_its_padding():
    mask = np.zeros((3, 11), bool)
    mask[0, :4] = mask[2, 10] = True
    figures = BitMap.from_mask(mask, *PLACE).figures()
    names = ("occupied", "free", "unknown", "between", "width", "height")
    assert [figures[name] for name in names] == [5, 28, 0, 0, 11, 3]
