import numpy as np
import pytest
from hypothesis import given

import oracles
from mapdeal.kernels.distance import signed_squared_distance, squared_distance, unreachable
from strategies import masks


@given(masks())
def test_squared_distance_equals_brute_force(marked):
    expected = oracles.squared_distance(marked)
    squared = squared_distance(marked)
    if not marked.any():
        assert (squared == unreachable(squared)).all()
    else:
        assert np.array_equal(squared, expected)


@given(masks())
def test_signed_distance_is_positive_outside_and_negative_inside(occupied):
    signed = signed_squared_distance(occupied)
    outside, inside = oracles.squared_distance(occupied), oracles.squared_distance(~occupied)
    far = unreachable(signed)
    for index in np.ndindex(occupied.shape):
        side = inside if occupied[index] else outside
        expected = far if side[index] is None else side[index]
        assert signed[index] == (-expected if occupied[index] else expected)


def test_a_grid_without_marked_cell_is_nowhere_near_one():
    squared = squared_distance(np.zeros((3, 5), dtype=bool))
    assert (squared == np.iinfo(squared.dtype).max).all()


@pytest.mark.parametrize("shape", [(1, 46_400), (46_400, 1)])
def test_squares_beyond_32_bits_do_not_overflow(shape):
    marked = np.zeros(shape, dtype=bool)
    marked.flat[0] = True
    squared = squared_distance(marked)
    assert squared.flat[-1] == 46_399**2


def test_the_input_is_not_touched():
    marked = np.array([[True, False], [False, False]])
    before = marked.copy()
    marked.flags.writeable = False
    squared_distance(marked)
    signed_squared_distance(marked)
    assert np.array_equal(marked, before)
