import numpy as np
import pytest

from mapdeal.kernels.components import gap_at
from mapdeal.kernels.distance import squared_distance


def room_with_a_wall(first, last, gap, thickness, turned):
    """Two rooms beside each other and a wall between them, columns 12 and on, with a gap."""
    occupied = np.zeros((31, 40), dtype=bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[:, 12 : 12 + thickness] = True
    occupied[first:last, 12 : 12 + thickness] = False
    return occupied.T.copy() if turned else occupied


def basins_of(occupied):
    return np.where(occupied, -1, 0).astype(np.int32)


def narrowest_cells(occupied, squared, first, last, thickness, turned):
    inside = np.zeros_like(occupied)
    (inside.T if turned else inside)[first:last, 12 : 12 + thickness] = True
    widest = squared[inside].max()
    return [tuple(cell) for cell in np.argwhere(inside & (squared == widest)).tolist()]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("thickness", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("gap", [1, 2, 3, 4, 7, 8])
def test_the_bar_lies_across_the_middle_of_the_door(gap, thickness, turned):
    first = 9
    last = first + gap
    occupied = room_with_a_wall(first, last, gap, thickness, turned)
    squared = squared_distance(occupied)
    cells = narrowest_cells(occupied, squared, first, last, thickness, turned)
    assert len(cells) >= thickness
    for cell in cells:  # any of them may be the saddle
        ends = gap_at(squared, basins_of(occupied), cell)
        if turned:
            ends = [end[::-1] for end in ends]
        (low, column), (high, other) = ends
        assert (low, high) == (first - 1, last)
        assert column == other
        assert abs(column - (12 + (thickness - 1) / 2)) <= 0.5


def test_the_ridge_does_not_run_along_the_walls_of_rooms():
    # The saddle is as far from the wall as are the cells along it.
    occupied = np.zeros((30, 40), dtype=bool)
    occupied[0] = True
    occupied[4, 6] = True
    squared = squared_distance(occupied)
    assert squared[2, 6] == squared[2, 30] == 4
    assert gap_at(squared, basins_of(occupied), (2, 6)) == ((0.0, 6.0), (4.0, 6.0))


def test_a_diagonal_gap_is_crossed_from_corner_to_corner():
    occupied = np.zeros((20, 20), dtype=bool)
    for k in range(20):
        occupied[k, k] = True
        occupied[k, min(k + 1, 19)] = True
    for k in (8, 9, 10):
        occupied[k, k : k + 2] = False
    squared = squared_distance(occupied)
    along = [(k, k) for k in range(7, 12)] + [(k, k + 1) for k in range(7, 12)]
    saddle = max(along, key=lambda cell: squared[cell])
    first, second = gap_at(squared, basins_of(occupied), saddle)
    assert {first, second} <= {(7.0, 7.0), (7.0, 8.0), (11.0, 11.0), (11.0, 12.0)}
    assert first[0] == 7
    assert second[0] == 11


def test_where_there_is_no_obstacle_opposite_the_bar_ends_where_ways_do():
    occupied = np.zeros((12, 20), dtype=bool)
    occupied[2] = True
    basins = basins_of(occupied)
    basins[6:, 9:12] = -1  # unknown
    squared = squared_distance(occupied)
    assert gap_at(squared, basins, (5, 10)) == ((2.0, 10.0), (6.0, 10.0))


def test_the_edge_is_an_obstacle():
    occupied = np.zeros((12, 20), dtype=bool)
    occupied[2] = True
    squared = squared_distance(np.pad(occupied, 1, constant_values=True))[1:-1, 1:-1]
    assert gap_at(squared, basins_of(occupied), (7, 8)) == ((2.0, 9.0), (12.0, 9.0))
    alone = np.ones((1, 1), dtype=np.int32)
    assert gap_at(alone, basins_of(alone == 0), (0, 0)) == ((-1.0, 0.0), (1.0, 0.0))


def test_the_bar_lies_in_the_middle_of_a_long_door():
    occupied = np.ones((9, 300), dtype=bool)
    occupied[1:8, 1:20] = occupied[1:8, 280:299] = False
    occupied[3:6, 20:280] = False
    squared = squared_distance(occupied)
    for col in (25, 140, 275):
        ends = gap_at(squared, basins_of(occupied), (4, col))
        assert ends == ((2, pytest.approx(149.5, abs=1)), (6, pytest.approx(149.5, abs=1)))
