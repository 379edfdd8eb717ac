import numpy as np
from hypothesis import given

import oracles
from drawn import cells
from mapdeal.kernels.components import touching_groups
from strategies import masks


def as_sets(found):
    listed, groups = found
    return [{tuple(cell) for cell in listed[groups == k].tolist()} for k in np.unique(groups)]


@given(masks())
def test_groups_are_those_of_flooding(marked):
    listed, groups = touching_groups(marked)
    assert listed.tolist() == np.argwhere(marked).tolist()
    expected = sorted(oracles.groups(marked), key=min)  # in the order of their first cells
    assert as_sets((listed, groups)) == expected
    assert groups.tolist() == [
        next(k for k, group in enumerate(expected) if tuple(cell) in group)
        for cell in listed.tolist()
    ]


def test_a_spiral_is_one_group_and_nothing_wraps():
    spiral = cells("""
        #########.#
        #.......#..
        #.#####.#.#
        #.#...#.#.#
        #.#.###.#..
        #.#.....#..
        #.#######..
    """)
    sizes = [len(group) for group in as_sets(touching_groups(spiral == 100))]
    # row 0 is the last line: the column at the right edge, and the cell above it, stand alone
    assert sorted(sizes) == [1, 2, (spiral == 100).sum() - 3]


def test_a_long_snake_is_one_group():
    """Many rounds of joining: cells of one diagonal after the other."""
    marked = np.zeros((60, 400), bool)
    marked[::4] = True
    marked[2::4, ::2] = True
    marked[1::4, -1] = marked[3::4, 0] = True
    _, groups = touching_groups(marked)
    assert groups.max() + 1 == len(list(oracles.groups(marked)))
