import numpy as np
from hypothesis import given

import oracles
from drawn import cells
from mapdeal.kernels.components import thickness_of
from strategies import masks


@given(masks())
def test_thickness_is_that_of_walking_along_row_and_column(marked):
    expected = oracles.thickness(marked)
    assert thickness_of(marked).tolist() == [expected[cell] for cell in sorted(expected)]


def test_walls_of_one_two_and_three_cells():
    drawn = cells("""
        ########..
        ..........
        .##....##.
        .##...##..
        .##..##...
        ....##.###
        .......###
        .......###
    """)
    found = np.zeros(drawn.shape, int)
    found[drawn == 100] = thickness_of(drawn == 100)
    assert found[::-1].tolist() == [
        [1, 1, 1, 1, 1, 1, 1, 1, 0, 0],
        [0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        [0, 2, 2, 0, 0, 0, 0, 2, 1, 0],
        [0, 2, 2, 0, 0, 0, 2, 2, 0, 0],
        [0, 2, 2, 0, 0, 2, 2, 0, 0, 0],
        [0, 0, 0, 0, 1, 2, 0, 3, 3, 3],
        [0, 0, 0, 0, 0, 0, 0, 3, 3, 3],
        [0, 0, 0, 0, 0, 0, 0, 3, 3, 3],
    ]


def test_nothing_has_no_thickness():
    assert thickness_of(np.zeros((3, 5), bool)).tolist() == []
