import math

import numpy as np
import pytest

from drawn import cells
from mapdeal import OccupancyGrid
from mapdeal.grid.frame import Frame
from mapdeal.grid.ways import Ground, Ways, largest_closed_square
from mapdeal.kernels.clearance_tree import clearance_tree
from mapdeal.kernels.distance import squared_distance


def ways_of(text):
    grid = OccupancyGrid(cells(text), 0.25, (1.5, -2.0, 0.4))
    squared = squared_distance(grid.occupied())
    return Ways(clearance_tree(squared, ~grid.occupied() & ~grid.unknown()), squared, grid.frame)


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


@pytest.mark.parametrize("resolution", [0.05, 0.07, 0.3, 1e-6, 1e6])
def test_a_distance_of_the_radius_itself_is_closed(resolution):
    frame = Frame(100, 100, resolution)
    for square in range(1, 2000):
        radius = math.sqrt(square) * resolution
        assert largest_closed_square(radius, frame) == square
        assert largest_closed_square(np.nextafter(radius, 0), frame) == square - 1


def test_where_no_obstacle_is_no_radius_closes_a_cell():
    frame = Frame(5, 5, 1e-3)
    grid = OccupancyGrid(np.zeros((5, 5), np.int8), 1e-3)
    squared = squared_distance(grid.occupied())
    assert largest_closed_square(1000.0, frame) < squared.min()
    ways = Ground(grid.occupancy, frame, through_unknown=False).ways()
    assert ways.in_largest_area(largest_closed_square(1000.0, frame)).all()
