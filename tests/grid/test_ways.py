import math
from decimal import Decimal

import numpy as np
import pytest

from drawn import cells
from mapdeal import OccupancyGrid
from mapdeal.grid.frame import Frame
from mapdeal.grid.reaching import Ground, largest_closed_square, squares_to
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


def test_from_where_no_robot_stands_nothing_is_reached():
    ways = ways_of(TWO_ROOMS_AND_A_LARGER_ONE)
    beside_a_wall = ways.begun_at((1, 1))
    assert beside_a_wall.reachable(0)[5, 1] == 1
    assert not beside_a_wall.reachable(1).any()
    in_a_wall = ways.begun_at((0, 0))
    assert not in_a_wall.reachable(0).any()
    assert not in_a_wall.widest().any()
    assert in_a_wall.widest_square_at((1, 1)) == 0


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


def test_no_robot_is_larger_than_its_map():
    frame = Frame(5, 9, 1e-3)
    ways = Ground(np.zeros((5, 9), np.int8), frame, through_unknown=False).ways()
    assert ways.in_largest_area(largest_closed_square(0.0029, frame)).sum() == 5
    for radius in (0.003, 1000.0):
        assert ways.in_largest_area(largest_closed_square(radius, frame)) is None
