import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn import cells
from mapdeal import OccupancyGrid, ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.reaching import (
    Ground,
    cell_of_point,
    largest_closed_square,
    nearest_marked,
    nearest_open_text,
    squares_to,
)
from mapdeal.kernels.distance import squared_distance


def ways_of(text):
    grid = OccupancyGrid(cells(text), 0.25, (1.5, -2.0, 0.4))
    return Ground(grid.occupancy, grid.frame, through_unknown=False).ways()


TWO_ROOMS_AND_A_LARGER_ONE = """
    #######################
    #.....#.....##.......##
    #.....#.....##.......##
    #...........##.......##
    #.....#.....##.......##
    #.....#.....##.......##
    #######################
    """


def test_areas_that_only_a_closed_door_joins_are_not_one():
    ways = ways_of(TWO_ROOMS_AND_A_LARGER_ONE)
    cols = {limit: np.argwhere(ways.in_largest_area(limit))[:, 1] for limit in (0, 1)}
    assert (len(cols[0]), cols[0].max() < 12) == (51, True)  # in two rooms, and 35 in one
    assert (len(cols[1]), cols[1].min() > 13) == (15, True)  # 9 and 9, and 15


def test_there_is_no_largest_area_where_nothing_is_open():
    assert ways_of(TWO_ROOMS_AND_A_LARGER_ONE).in_largest_area(9) is None
    assert ways_of("###").in_largest_area(0) is None


@pytest.mark.parametrize("resolution", ["0.05", "0.07", "0.3", "1e-3", "1000"])
def test_a_distance_of_the_radius_itself_is_closed(resolution):
    frame = Frame(100, 100, float(resolution))
    for square in range(1, 2000):
        radius = math.sqrt(square) * float(resolution)
        assert largest_closed_square(radius, frame) == square
        assert largest_closed_square(radius - 3e-9, frame) == square - 1
    for count in range(1, 50):  # on paper: 6 * 0.05 is more than 0.3 in floats
        radius = float(count * Decimal(resolution))
        assert largest_closed_square(radius, frame) == count**2


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1), (9, 14), (40, 33)])
def test_outside_of_the_map_all_is_marked(shape):
    """By hand: the distances on a map with a margin of marked cells."""
    marked = np.random.default_rng(3).random(shape) < 0.02
    with_margin = np.pad(marked, 1, constant_values=True)
    assert np.array_equal(squares_to(marked), squared_distance(with_margin)[1:-1, 1:-1])


FRAME = Frame(3, 5, 0.5, (2.0, 1.0, math.pi / 2))


def test_cells_of_points_and_where_the_map_lies():
    assert cell_of_point(FRAME, (1.75, 1.25), "start") == (0, 0)
    with pytest.raises(ParameterError, match="start: lies outside") as caught:
        cell_of_point(FRAME, (2.25, 1.25), "start")
    assert caught.value.hint == "the map lies within x 0.5 .. 2, y 1 .. 3.5"


@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_the_nearest_open_cell_is_that_of_a_search_through_all(height, width, count, seed):
    rng = np.random.default_rng(seed)
    marked = np.zeros((height, width), dtype=bool)
    for _ in range(count):
        marked[rng.integers(height), rng.integers(width)] = True
    cell = (int(rng.integers(-height, 2 * height)), int(rng.integers(-width, 2 * width)))
    told = nearest_open_text(Frame(height, width, 0.5, (-3.0, 2.0, 0.0)), marked, cell)
    cells = sorted((math.dist(one, cell), *one) for one in np.argwhere(marked).tolist())
    if not cells:
        assert told == "no cell of the map is open"
        return
    distance, row, col = cells[0]
    place = f"{-3.0 + (col + 0.5) * 0.5:.10g},{2.0 + (row + 0.5) * 0.5:.10g}"
    assert told == f"the nearest open cell is {distance * 0.5:.3g} m away, at {place}"


def test_the_nearest_cell_to_one_that_is_very_far_away():
    marked = np.zeros((60, 60), dtype=bool)
    marked[16, 16] = marked[0, 17] = marked[59, 0] = True
    assert nearest_marked(marked, (-(10**18), 10**18)) == (0, 17)
    assert nearest_marked(marked, (10**18, 30)) == (59, 0)


def test_there_is_no_zero_below_zero():
    frame = Frame(2, 2, 0.5, (-0.5 - 1e-9, -1e-9, 0.0))
    with pytest.raises(ParameterError) as caught:
        cell_of_point(frame, (9.0, 9.0), "goal")
    assert caught.value.hint == "the map lies within x -0.5 .. 0.5, y 0 .. 1"
