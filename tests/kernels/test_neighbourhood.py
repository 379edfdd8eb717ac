import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal.kernels.neighbourhood import dilate_square, drop_small_groups
from strategies import masks


@given(masks(), st.integers(0, 20))
def test_dilation_equals_brute_force_and_never_wraps(marked, reach):
    assert np.array_equal(dilate_square(marked, reach), oracles.square_inflation(marked, reach))


def _groups(marked):
    """Sets of 8-connected cells, by flooding."""
    left = {tuple(cell) for cell in np.argwhere(marked).tolist()}
    while left:
        group, edge = set(), {left.pop()}
        while edge:
            group |= edge
            near = {(r + i, c + j) for r, c in edge for i in (-1, 0, 1) for j in (-1, 0, 1)}
            edge = near & left
            left -= edge
        yield group


@given(masks(), st.integers(0, 6))
def test_small_groups_are_dropped_whole(marked, least):
    expected = np.zeros_like(marked)
    for group in _groups(marked):
        for cell in group if len(group) >= least else ():
            expected[cell] = True
    assert np.array_equal(drop_small_groups(marked, least), expected)
