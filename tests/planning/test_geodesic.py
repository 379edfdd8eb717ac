"""Shortest ways in any direction, against ways over corners that see one another."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from mapdeal.kernels.eikonal import is_line_clear, lengths_to
from mapdeal.planning.goal_routes import shortest_way

FRAME = (0.25, (1.5, -2.0, 0.4))


@st.composite
def places(draw):
    """A mask of open cells, and two places in such cells, a row and a column each."""
    shape = draw(st.integers(2, 16)), draw(st.integers(2, 16))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    is_open = rng.random(shape) >= draw(st.sampled_from([0.05, 0.2, 0.35]))
    for row, col in rng.integers(0, shape, (draw(st.integers(0, 3)), 2)):
        is_open[row : row + 4, col : col + 3] = False
    ends = rng.integers(0, shape, (2, 2))
    is_open[tuple(ends.T)] = True
    return is_open, *(ends + 0.01 + 0.98 * rng.random((2, 2))).tolist()


@given(places())
def test_ways_are_within_a_fiftieth_of_the_shortest_and_in_open_cells(case):
    is_open, start, goal = case
    costmap = mapdeal.Costmap(np.where(is_open, 0, 254).astype(np.uint8), *FRAME)
    ends = costmap.frame.xy_from_continuous_rowcol([start, goal]).tolist()
    route = shortest_way(costmap, *map(tuple, ends))
    exact = oracles.shortest_way(is_open, start, goal)
    field = lengths_to(is_open, tuple(goal))
    reached = mapdeal.reach(costmap, start=tuple(ends[1]), radius=0.0).reachable
    assert (np.isfinite(field) == reached.astype(bool)).all()
    assert route.reached == math.isfinite(exact)
    if not route.reached:
        return
    assert exact * FRAME[0] * (1 - 1e-5) <= route.length <= exact * FRAME[0] * 1.02 + 1e-6
    assert route.points_xy[[0, -1]].tolist() == ends
    places = costmap.frame.continuous_rowcol_from_xy(route.points_xy)
    assert np.hypot(*np.diff(places, axis=0).T).max(initial=0.0) <= 0.5 + 1e-6

    def opens(cell):
        return all(0 <= k < n for k, n in zip(cell, is_open.shape, strict=True)) and is_open[cell]

    inner = list(map(tuple, places.tolist()))
    assert all(is_line_clear(opens, *piece) for piece in pairwise(inner))


@given(
    places(), st.lists(st.sampled_from([0.0, 1e-9, 1e-6, 0.5, 1 - 1e-6]), min_size=4, max_size=4)
)
def test_ends_at_edges_belong_to_the_cells_that_reach_says(case, offsets):
    """As typed by people: most round coordinates lie on edges or corners of cells."""
    is_open, *ends = case
    ends = np.floor(ends) + np.reshape(offsets, (2, 2))
    costmap = mapdeal.Costmap(np.where(is_open, 0, 254).astype(np.uint8), *FRAME)
    start, goal = costmap.frame.xy_from_continuous_rowcol(ends).tolist()
    cells, inside = costmap.frame.bounded_rowcol_from_xy([start, goal])
    if not inside.all() or not is_open[tuple(cells.T)].all():
        return
    reached = mapdeal.reach(costmap, start=tuple(goal), radius=0.0).reachable.astype(bool)
    route = shortest_way(costmap, tuple(start), tuple(goal))
    assert route.reached == reached[tuple(cells[0])]
    grid = mapdeal.OccupancyGrid(np.where(is_open, 0, 100).astype(np.int8), *FRAME)
    field = mapdeal.potential(grid, goal=tuple(goal))
    assert (np.isfinite(field.cost_to_go) == reached).all()


def test_the_largest_cost_multiplier_leads_to_the_border():
    costmap = mapdeal.Costmap(np.uint8([[0, 252, 0], [0, 0, 100]]), 0.25, (1.5, -2.0, 0.0))
    with pytest.warns(mapdeal.MapdealWarning, match="is beyond the map"):
        answer = mapdeal.route(
            costmap, start=(1.6, -1.9), goal=(9.0, 9.0), method="astar", cost_travel_multiplier=1e6
        )
    assert answer.beyond_window


def test_a_way_bends_at_the_corner_of_a_wall():
    grid = grid_from_text("""
        .....
        ####.
        .....
    """)
    costmap = mapdeal.Costmap(np.where(grid.occupancy == 100, 254, 0).astype(np.uint8), *FRAME)
    start, goal = costmap.frame.xy_from_continuous_rowcol([[0.5, 0.5], [2.5, 0.5]]).tolist()
    route = shortest_way(costmap, tuple(start), tuple(goal))
    assert route.length == pytest.approx((2 * math.hypot(3.5, 0.5) + 1) * 0.25, rel=1e-3)
    assert (route.method, route.optimal, route.expanded) == ("geodesic", False, None)
