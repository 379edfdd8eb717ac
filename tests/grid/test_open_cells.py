"""Cells of points, and the nearest open one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.reaching import cell_of_point, nearest_marked, nearest_open_text

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
