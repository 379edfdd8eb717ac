import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal.kernels.distance import squared_distance, unreachable
from mapdeal.stages.layered_cost import queue_squares
from strategies import masks


def queue_of_costmap_2d(seeds, reach):
    """updateCosts of ROS 1's inflation_layer.cpp, cell by cell; None where it does not come."""
    height, width = seeds.shape
    bins = {0: [(my, mx, my, mx) for my, mx in np.argwhere(seeds).tolist()]}
    found = np.full(seeds.shape, None)
    level = 0
    while level <= reach * reach:
        entries = bins.get(level, [])
        index = 0
        while index < len(entries):  # it may grow
            my, mx, sy, sx = entries[index]
            index += 1
            if found[my, mx] is not None:
                continue
            found[my, mx] = level
            for ny, nx in ((my, mx - 1), (my - 1, mx), (my, mx + 1), (my + 1, mx)):
                if 0 <= ny < height and 0 <= nx < width and found[ny, nx] is None:
                    square = (ny - sy) ** 2 + (nx - sx) ** 2
                    if square <= reach * reach:
                        bins.setdefault(square, []).append((ny, nx, sy, sx))
        level += 1
    return found


@settings(max_examples=200)
@given(masks(longest=20), st.integers(0, 9))
def test_the_queue_equals_its_original_cell_by_cell(seeds, reach):
    made = queue_squares(seeds, reach)
    expected = queue_of_costmap_2d(seeds, reach)
    never = unreachable(made)
    assert made.tolist() == [[never if one is None else one for one in row] for row in expected]


def test_the_queue_overestimates_a_few_distances_and_no_more():
    seeds = np.random.default_rng(1).random((200, 230)) < 0.004
    made, exact = queue_squares(seeds, 20), squared_distance(seeds)
    near = exact <= 400
    assert (made[near] >= exact[near]).all()
    assert np.count_nonzero(made[near] != exact[near]) == 6
    assert np.array_equal(made != unreachable(made), near)
    worst = np.sqrt(made[near]) - np.sqrt(exact[near])
    assert worst.max() < 0.25  # cells
