"""Descent of the potential, and geodesic routes against visible corners."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
import oracles
from drawn import cells, grid_from_text
from mapdeal.kernels.paths import is_line_clear, lengths_to
from mapdeal.planning import routes as descent
from mapdeal.planning.routes import Terrain, shortest_over

ORIGIN = (1.5, -2.0, 0.4)


def _xy(grid, row, col):
    return tuple(grid.frame.xy_from_continuous_rowcol([[row, col]])[0].tolist())


def _costmap(grid):
    """Obstacles lethal, unknown cells unknown."""
    return mapdeal.Costmap.from_occupancy(grid)


def _descent(grid, start, goal, through_unknown=False, **options):
    """The way down between two places in cells."""
    field = mapdeal.potential(grid, goal=_xy(grid, *goal), **options)
    return _descend(_costmap(grid), field, _xy(grid, *start), through_unknown=through_unknown)


def _descend(costmap, field, start, **options):
    terrain, surface = Terrain.of(costmap, **options), field.downhill_surface()
    return descent.descend_on(terrain, surface, start, field.goal)


def _closed_share(is_open, start, end):
    """How much of a straight piece of way lies in closed cells, by looking at many places."""
    shares = np.linspace(0, 1, 201)[:, np.newaxis]
    cells = np.floor(np.array(start) * (1 - shares) + np.array(end) * shares + 1e-7).astype(int)
    cells = np.clip(cells, 0, np.array(is_open.shape) - 1)
    return float((~is_open[cells[:, 0], cells[:, 1]]).mean())


def _is_wide_open(is_open, start, end):
    """Whether nothing closed lies within a hundredth of a cell of a straight piece of way."""
    offsets = [np.array([row, col]) for row in (-0.01, 0.01) for col in (-0.01, 0.01)]
    return all(_closed_share(is_open, start + by, end + by) == 0 for by in offsets)


EMPTY = mapdeal.OccupancyGrid(np.zeros((40, 60), np.int8), 0.25, ORIGIN)


@pytest.mark.parametrize("goal", [(3.2, 50.5), (35.5, 48.0), (38.5, 3.3), (2.5, 2.5)])
def test_without_obstacles_the_way_is_straight(goal):
    route = _descent(EMPTY, (20.3, 25.7), goal)
    assert route.reached
    assert route.local_minimum is None
    ends = _xy(EMPTY, 20.3, 25.7), _xy(EMPTY, *goal)
    assert route.points_xy[[0, -1]] == pytest.approx(np.array(ends))
    assert math.dist(*ends) <= route.length < 1.01 * math.dist(*ends)
    assert route.cost == pytest.approx(route.length)


def test_an_obstacle_beside_the_way_is_passed_in_a_bow():
    occupancy = np.zeros((40, 60), np.int8)
    occupancy[18:21, 30] = 100
    grid = EMPTY.with_values(occupancy)
    route = _descent(grid, (20.5, 5.5), (20.5, 55.5), attractive_gain=10.0)
    assert route.reached
    assert grid.frame.continuous_rowcol_from_xy(route.points_xy)[:, 0].max() > 22
    assert route.min_clearance > 0.25


TRAP = """
..............
.....#####....
.........#....
.........#....
.........#....
.....#####....
..............
"""


def test_a_pocket_is_a_local_minimum_and_its_place_is_named():
    grid = grid_from_text(TRAP, 0.25, ORIGIN)
    route = _descent(grid, (3.5, 1.5), (3.5, 13.5), attractive_gain=100.0)
    assert not route.reached
    assert route.local_minimum == tuple(route.points_xy[-1])
    row, col = grid.frame.continuous_rowcol_from_xy([route.local_minimum])[0]
    assert 2 < row < 5
    assert 6 < col < 9


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.1, 0.3]),
    st.sampled_from([1.0, 30.0, 1000.0]), st.booleans(),
)  # fmt: skip
def test_steps_lead_down_and_nothing_is_lower_at_the_end(seed, density, gain, through_unknown):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(3, 14, 2)
    occupancy = np.where(rng.random((height, width)) < density, 100, 0).astype(np.int8)
    occupancy[rng.random((height, width)) < 0.05] = -1
    grid_cells = [tuple(int(n) for n in rng.integers(0, (height, width))) for _ in "ab"]
    for cell in grid_cells:
        occupancy[cell] = 0
    grid = mapdeal.OccupancyGrid(occupancy, 0.25, ORIGIN)
    start, goal = (_xy(grid, *(np.array(cell) + rng.random(2))) for cell in grid_cells)
    field = mapdeal.potential(grid, goal=goal, attractive_gain=gain)
    route = _descend(_costmap(grid), field, start, through_unknown=through_unknown)
    surface = field.downhill_surface()
    places = grid.frame.continuous_rowcol_from_xy(route.points_xy)
    is_open = (occupancy == 0) | (through_unknown & (occupancy == -1))
    on_way = places[:-1] if route.reached else places
    heights = [oracles.bilinear(surface, *place)[0] for place in on_way.tolist()]
    assert all(after < before + 1e-9 for before, after in pairwise(heights))
    pieces = list(pairwise(places.tolist()))
    assert all(_closed_share(is_open, a, b) < 0.01 for a, b in pieces)
    in_cells = np.clip(np.floor(places + 1e-6).astype(int), 0, (height - 1, width - 1))
    assert is_open[tuple(in_cells.T)].all()
    assert all(math.dist(a, b) <= 1.5 * math.sqrt(2) + 1e-9 for a, b in pieces)
    if route.reached:
        in_its_cell = (np.floor(places[-2]) == np.floor(places[-1])).all()
        assert in_its_cell or math.dist(route.points_xy[-2], goal) <= 0.25 + 1e-9
        return
    row, col = (int(n) for n in np.floor(places[-1] + 1e-9))
    for r in range(max(row - 1, 0), min(row + 2, height)):
        for c in range(max(col - 1, 0), min(col + 2, width)):
            if is_open[r, c] and _is_wide_open(is_open, places[-1], (r + 0.5, c + 0.5)):
                assert surface[r, c] >= heights[-1] - 1e-9


def test_closed_cells_hold_the_way_up():
    grid = grid_from_text("...?...\n...?...\n...?...", 0.25, ORIGIN)
    closed = _descent(grid, (1.5, 0.5), (1.5, 6.5))
    assert not closed.reached
    assert grid.frame.continuous_rowcol_from_xy([closed.local_minimum])[0, 1] <= 3.0 + 1e-9
    assert _descent(grid, (1.5, 0.5), (1.5, 6.5), through_unknown=True).reached


@pytest.mark.parametrize(("start", "goal"), [((0.1, 0.1), (0.9, 0.9)), ((0.9, 0.1), (0.2, 0.8))])
def test_a_goal_in_the_start_s_own_cell_is_reached(start, goal):
    route = _descent(grid_from_text(".", 0.25, ORIGIN), start, goal)
    assert route.reached
    assert route.length == pytest.approx(math.dist(start, goal) * 0.25)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.2]))
def test_the_clearance_is_the_least_distance_to_the_centre_of_an_obstacle(seed, density):
    occupancy = np.where(np.random.default_rng(seed).random((9, 13)) < density, 100, 0)
    occupancy[0, 0] = occupancy[8, 12] = 0
    grid = mapdeal.OccupancyGrid(occupancy, 0.25, ORIGIN)
    route = _descent(grid, (0.9, 0.05), (8.1, 12.9), attractive_gain=20.0)
    centres = grid.frame.xy_from_rowcol(np.argwhere(occupancy == 100)).tolist()
    expected = oracles.clearances(route.points_xy.tolist(), centres)
    assert (route.min_clearance, route.mean_clearance) == pytest.approx(expected)
    assert (route.expanded, route.optimal) == (None, False)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_before_closed_cells_the_way_slides_on_to_the_goal(real_maps):
    grid = mapdeal.read_map(next(real_maps.rglob("depot.yaml")))
    costs = {"inscribed_radius": 0.22, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}
    field = mapdeal.potential(grid, goal=(29.875, 14.725), attractive_gain=300.0)
    assert _descend(mapdeal.exponential_cost(grid, **costs), field, (0.675, 0.475)).reached


def test_a_way_without_end_is_given_up(monkeypatch):
    monkeypatch.setattr(descent, "_STEPS_PER_CELL_OF_SIDE", 2)
    assert _descent(EMPTY, (1.5, 1.5), (35.5, 55.5)).reached
    monkeypatch.setattr(descent, "_STEPS_PER_CELL_OF_SIDE", 0.5)
    route = _descent(EMPTY, (1.5, 1.5), (35.5, 55.5))
    assert (route.reached, route.local_minimum, len(route.points_xy)) == (False, None, 51)
    ends = {"start": _xy(EMPTY, 1.5, 1.5), "goal": _xy(EMPTY, 35.5, 55.5)}
    with pytest.raises(mapdeal.FindingError, match="map: stopped after"):
        mapdeal.route(_costmap(EMPTY), **ends, method="descent").check()


def _slope(surface, drawing=None):
    surface = np.array(surface, dtype=np.float64)
    closed = np.zeros(surface.shape) if drawing is None else cells(drawing) == 100
    terrain = Terrain.of(mapdeal.Costmap((closed * 254).astype(np.uint8), 0.25, ORIGIN))
    return descent._Slope(surface, terrain)


def test_the_lowest_neighbour_is_that_of_the_steepest_way():
    surface = [[9, 9, 9, 9], [9, 8, 6, 9], [9, 5, 9, 9]]
    slope = _slope(surface)
    # from the centre of 8: 3 down over one cell, 2 over one to the side
    assert slope._lowest_neighbour((1.5, 1.5), 8.0) == (2.5, 1.5)
    surface[2][2] = 4  # 4 down over 1.41 cells is 2.83 a cell, less steep
    assert _slope(surface)._lowest_neighbour((1.5, 1.5), 8.0) == (2.5, 1.5)
    surface[2][2] = 3  # 5 over 1.41 cells is 3.54 a cell
    assert _slope(surface)._lowest_neighbour((1.5, 1.5), 8.0) == (2.5, 2.5)
    closed = _slope(surface, "...#\n....\n....")  # drawn with the north at the top
    assert closed._lowest_neighbour((1.5, 1.5), 8.0) == (2.5, 2.5)
    closed = _slope(surface, "..#.\n....\n....")
    assert closed._lowest_neighbour((1.5, 1.5), 8.0) == (2.5, 1.5)
    assert slope._lowest_neighbour((0.5, 3.5), 6.0) is None
    # away from a centre its own cell counts too
    assert _slope([[9, 2, 9]])._lowest_neighbour((0.5, 1.2), 3.0) == (0.5, 1.5)


@given(st.integers(0, 2**32 - 1))
def test_values_and_gradients_are_blends_of_those_at_the_centres_around(seed):
    rng = np.random.default_rng(seed)
    surface = rng.uniform(-9, 9, rng.integers(1, 8, 2))
    slope, place = _slope(surface), tuple(rng.random(2) * surface.shape)
    along_cols, along_rows = oracles.slopes_along_map_axes(surface, 1.0, 0.0)
    value, *gradient = (oracles.bilinear(k, *place)[0] for k in (surface, along_rows, along_cols))
    assert slope.value_at(place) == pytest.approx(value, abs=1e-12)
    assert slope._gradient_at(place) == pytest.approx(gradient, abs=1e-12)


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
    route = shortest_over(Terrain.of(costmap), *map(tuple, ends))
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


@given(places(), st.tuples(*[st.sampled_from([0.0, 1e-9, 1e-6, 0.5, 1 - 1e-6])] * 4))
def test_ends_at_edges_belong_to_the_cells_that_reach_says(case, offsets):
    is_open, *ends = case
    ends = np.floor(ends) + np.reshape(offsets, (2, 2))
    costmap = mapdeal.Costmap(np.where(is_open, 0, 254).astype(np.uint8), *FRAME)
    start, goal = costmap.frame.xy_from_continuous_rowcol(ends).tolist()
    cells, inside = costmap.frame.bounded_rowcol_from_xy([start, goal])
    if not inside.all() or not is_open[tuple(cells.T)].all():
        return
    reached = mapdeal.reach(costmap, start=tuple(goal), radius=0.0).reachable.astype(bool)
    route = shortest_over(Terrain.of(costmap), tuple(start), tuple(goal))
    assert route.reached == reached[tuple(cells[0])]
    grid = mapdeal.OccupancyGrid(np.where(is_open, 0, 100).astype(np.int8), *FRAME)
    assert (np.isfinite(mapdeal.potential(grid, goal=tuple(goal)).cost_to_go) == reached).all()


def test_the_largest_cost_multiplier_leads_to_the_border():
    costmap = mapdeal.Costmap(np.uint8([[0, 252, 0], [0, 0, 100]]), 0.25, (1.5, -2.0, 0.0))
    ends = {"start": (1.6, -1.9), "goal": (9.0, 9.0)}
    with pytest.warns(mapdeal.MapdealWarning, match="is beyond the map"):
        assert mapdeal.route(costmap, **ends, cost_travel_multiplier=1e6).beyond_window


def test_a_way_bends_at_the_corner_of_a_wall():
    grid = grid_from_text(".....\n####.\n.....")
    costmap = mapdeal.Costmap(np.where(grid.occupancy == 100, 254, 0).astype(np.uint8), *FRAME)
    start, goal = costmap.frame.xy_from_continuous_rowcol([[0.5, 0.5], [2.5, 0.5]]).tolist()
    route = shortest_over(Terrain.of(costmap), tuple(start), tuple(goal))
    assert route.length == pytest.approx((2 * math.hypot(3.5, 0.5) + 1) * 0.25, rel=1e-3)
    assert (route.method, route.optimal, route.expanded) == ("geodesic", False, None)
