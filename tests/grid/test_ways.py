import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.reaching import (
    cell_of_point,
    largest_closed_square,
    nearest_marked,
    nearest_open_text,
)


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


@pytest.mark.parametrize(
    ("frame", "within"),
    [
        (Frame(3, 5, 0.5, (2.0, 1.0, math.pi / 2)), "x 0.5 .. 2, y 1 .. 3.5"),
        (Frame(2, 2, 0.5, (-0.5 - 1e-9, -1e-9, 0.0)), "x -0.5 .. 0.5, y 0 .. 1"),  # no zero below 0
    ],
)
def test_cells_of_points_and_where_the_map_lies(frame, within):
    corner = tuple(frame.xy_from_continuous_rowcol([[0.1, 0.1]])[0])
    assert cell_of_point(frame, corner, "start") == (0, 0)
    with pytest.raises(ParameterError, match="start: lies outside") as caught:
        cell_of_point(frame, (2.25, 1.25), "start")
    assert caught.value.hint == f"the map lies within {within}"


@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_the_nearest_open_cell_is_that_of_a_search_through_all(height, width, count, seed):
    rng = np.random.default_rng(seed)
    marked = np.zeros((height, width), dtype=bool)
    marked[rng.integers(height, size=count), rng.integers(width, size=count)] = True
    cell = (int(rng.integers(-height, 2 * height)), int(rng.integers(-width, 2 * width)))
    told = nearest_open_text(Frame(height, width, 0.5, (-3.0, 2.0, 0.0)), marked, cell)
    if not count:
        assert told == "no cell of the map is open"
        return
    distance, row, col = min((math.dist(one, cell), *one) for one in np.argwhere(marked).tolist())
    place = f"{-3.0 + (col + 0.5) * 0.5:.10g},{2.0 + (row + 0.5) * 0.5:.10g}"
    assert told == f"the nearest open cell is {distance * 0.5:.3g} m away, at {place}"


def test_the_nearest_cell_to_one_that_is_very_far_away():
    marked = np.zeros((60, 60), dtype=bool)
    marked[16, 16] = marked[0, 17] = marked[59, 0] = True
    assert nearest_marked(marked, (-(10**18), 10**18)) == (0, 17)
    assert nearest_marked(marked, (10**18, 30)) == (59, 0)
