"""The bit map against a plain array of bool."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import BitMap, OccupancyGrid

PLACE = (0.25, (1.5, -2.0, 0.4))


@st.composite
def masks(draw):
    shape = draw(st.integers(1, 9)), draw(st.integers(1, 35))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return rng.random(shape) < draw(st.sampled_from([0.0, 0.1, 0.5, 1.0]))


@given(masks())
def test_the_way_there_and_back(mask):
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.shape == mask.shape
    assert np.array_equal(bits.to_mask(), mask)
    assert np.array_equal(bits.to_occupancy().occupancy, mask * np.int8(100))
    assert np.array_equal(BitMap.from_occupancy(bits.to_occupancy()).packed, bits.packed)
    assert bits.count() == mask.sum()
    assert bits.frame == OccupancyGrid(mask * np.int8(100), *PLACE).frame


@given(masks())
def test_every_bit_is_where_the_document_says(mask):
    packed = BitMap.from_mask(mask, *PLACE).packed
    assert packed.shape == (mask.shape[0], -(-mask.shape[1] // 8))
    for row, col in np.ndindex(mask.shape):
        assert (packed[row, col // 8] >> (7 - col % 8)) & 1 == mask[row, col]
    assert not np.unpackbits(packed, axis=1)[:, mask.shape[1] :].any()


@given(masks(), st.data())
def test_get_and_set_of_many_cells(mask, data):
    height, width = mask.shape
    cell = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    cells = data.draw(st.lists(cell, max_size=20))
    value = data.draw(st.booleans())
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.get(cells).tolist() == [mask[cell] for cell in cells]
    changed = bits.set(cells, value)
    expected = mask.copy()
    for cell in cells:
        expected[cell] = value
    assert np.array_equal(changed.to_mask(), expected)
    assert np.array_equal(bits.to_mask(), mask)


@pytest.mark.parametrize("width", [1, 7, 8, 9, 16, 21])
def test_fill_leaves_the_padding_alone(width):
    bits = BitMap.from_mask(np.zeros((3, width)), *PLACE)
    full = bits.fill()
    assert full.to_mask().all()
    assert full.count() == 3 * width
    assert np.array_equal(full.packed, np.packbits(np.ones((3, width), bool), axis=1))
    assert not full.fill(False).packed.any()


def test_bits_behind_the_last_cell_are_cleared_on_the_way_in():
    given_bytes = np.full((2, 2), 0xFF, dtype=np.uint8)
    bits = BitMap(given_bytes, 11, *PLACE)
    assert bits.packed.tolist() == [[0xFF, 0xE0]] * 2
    assert (given_bytes == 0xFF).all()


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ([[-1, 0, 1, 100]], [False, False, True, True]),
        (np.array([[0, 1, 254, 255]], np.uint8), [False, True, True, True]),
        ([[0.0, 0.2, -0.5, math.inf]], [False, True, False, True]),
    ],
)
def test_any_value_above_0_is_a_1(mask, expected):
    assert BitMap.from_mask(mask, *PLACE).to_mask()[0].tolist() == expected


def test_obstacles_by_a_threshold():
    grid = OccupancyGrid([[-1, 0, 64, 65, 100]], *PLACE)
    assert BitMap.from_occupancy(grid).to_mask()[0].tolist() == [False] * 4 + [True]
    at_65 = BitMap.from_occupancy(grid, lethal_threshold=65)
    assert at_65.to_mask()[0].tolist() == [False] * 3 + [True] * 2


def test_lines_and_circles_are_drawn_in_the_map_frame_and_clipped():
    bits = BitMap.from_mask(np.zeros((5, 11)), *PLACE)
    ends = bits.frame.xy_from_rowcol([[1, 2], [1, 8]])
    line = bits.line(ends)
    assert np.argwhere(line.to_mask()).tolist() == [[1, col] for col in range(2, 9)]
    assert line.line([ends[0], ends[0]], value=False).count() == 6
    circle = bits.circle(tuple(bits.frame.xy_from_rowcol([[4, 5]])[0]), 0.25)
    assert np.argwhere(circle.to_mask()).tolist() == [[3, 5], [4, 4], [4, 5], [4, 6]]
    thick = bits.line(ends, thickness=0.5)
    assert thick.count() == 7 * 3 + 2


def test_cells_of_the_map_and_others():
    bits = BitMap.from_mask(np.zeros((2, 9)), *PLACE)
    inside = bits.contains([[0, 0], [1, 8], [2, 0], [0, 9], [-1, 0]])
    assert inside.tolist() == [True, True, False, False, False]
    assert bits.get([]).tolist() == []


def test_a_bit_map_cannot_be_changed():
    bits = BitMap.from_mask([[0, 1]], *PLACE)
    with pytest.raises(ValueError, match="read-only"):
        bits.packed[0, 0] = 0


def test_figures_of_a_bit_map_count_its_cells_and_not_its_padding():
    mask = np.zeros((3, 11), bool)
    mask[0, :4] = mask[2, 10] = True
    figures = BitMap.from_mask(mask, *PLACE).figures()
    names = ("occupied", "free", "unknown", "between", "width", "height")
    assert [figures[name] for name in names] == [5, 28, 0, 0, 11, 3]


def test_a_copy_has_bytes_of_its_own():
    bits = BitMap.from_mask([[0, 1, 0]], *PLACE)
    copy = bits.copy()
    assert not np.shares_memory(bits.packed, copy.packed)
    assert np.array_equal(bits.packed, copy.packed)
    assert copy.frame == bits.frame
