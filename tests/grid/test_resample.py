import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import Costmap, Frame, OccupancyGrid, ParameterError
from mapdeal.grid.canvas import obstacles_in, resampled, wholly_in
from mapdeal.kernels.threads import use_threads


def corners(frame, row, col):
    places = [[row, col], [row, col + 1], [row + 1, col + 1], [row + 1, col]]
    return [tuple(p) for p in frame.xy_from_continuous_rowcol(places).tolist()]


def shared_area(first, second):
    """The area that two convex anticlockwise polygons share: the second clips the first."""
    polygon = first
    for (ax, ay), (bx, by) in zip(second, second[1:] + second[:1], strict=True):
        kept = []
        for (px, py), (qx, qy) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
            q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
            if p >= 0:
                kept.append((px, py))
            if (p > 0 > q) or (p < 0 < q):
                t = p / (p - q)
                kept.append((px + t * (qx - px), py + t * (qy - py)))
        polygon = kept
    ends = polygon[1:] + polygon[:1]
    return sum(x * v - u * y for (x, y), (u, v) in zip(polygon, ends, strict=True)) / 2


YAWS = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi, math.pi / 4]), st.floats(-4, 4))
RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.025, 0.07, 0.3])


@given(
    shapes=st.tuples(*[st.integers(1, 6)] * 4), resolutions=st.tuples(RESOLUTIONS, RESOLUTIONS),
    yaws=st.tuples(YAWS, YAWS), shift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    seed=st.integers(0, 999), far=st.sampled_from([0.0, 5e6]),
)  # fmt: skip
@settings(deadline=None)
def test_a_cell_is_set_where_it_overlaps_an_obstacle(shapes, resolutions, yaws, shift, seed, far):
    frame = Frame(*shapes[:2], resolutions[0], (far - 1.5, 2.0, yaws[0]))
    source = Frame(*shapes[2:], resolutions[1], (far - 1.5 + shift[0], 2.0 + shift[1], yaws[1]))
    obstacles = np.random.default_rng(seed).random(source.shape) < 0.4
    found = obstacles_in(frame, obstacles, source)
    assert found.shape == frame.shape
    taken = [corners(source, *cell) for cell in np.argwhere(obstacles)]
    cell_area = min(resolutions) ** 2
    for cell in np.ndindex(frame.shape):
        area = max((shared_area(corners(frame, *cell), one) for one in taken), default=0.0)
        if area > 1e-5 * cell_area:
            assert found[cell]
        if found[cell] and not far:
            assert area > 1e-14 * cell_area


@pytest.mark.parametrize("far", [0.0, 3e5])
def test_the_same_lattice_is_copied(far):
    obstacles = np.random.default_rng(1).random((9, 14)) < 0.3
    source = Frame(9, 14, 0.05, (far + 0.1, -2.0, 0.3))
    found = obstacles_in(source.window(-2, 5, 8, 20), obstacles, source)
    expected = np.zeros((8, 20), bool)
    expected[2:, :9] = obstacles[:6, 5:]
    np.testing.assert_array_equal(found, expected)


def test_cells_that_only_touch_do_not_spread():
    """A wall of 0.1 m cells on lattices of 0.05 m and 0.2 m through the same corners."""
    wall = np.zeros((4, 4), bool)
    wall[:, 2] = True
    coarse = Frame(4, 4, 0.1, (-0.3, 0.7, 0.0))
    fine = obstacles_in(Frame(8, 8, 0.05, (-0.3, 0.7, 0.0)), wall, coarse)
    assert np.flatnonzero(fine.any(axis=0)).tolist() == [4, 5]
    assert fine[:, 4:6].all()
    coarser = obstacles_in(Frame(2, 2, 0.2, (-0.3, 0.7, 0.0)), wall, coarse)
    assert coarser.tolist() == [[False, True], [False, True]]


def test_a_quarter_turn_of_the_same_lattice():
    obstacles = np.array([[True, False, False], [False, False, True]])
    source = Frame(2, 3, 0.5, (1.0, 0.0, math.pi / 2))  # its columns go north, its rows west
    found = obstacles_in(Frame(3, 2, 0.5, (0.0, 0.0, 0.0)), obstacles, source)
    assert found.tolist() == [[False, True], [False, False], [True, False]]


def test_a_wall_stays_closed_when_it_is_turned():
    """A diagonal wall, whose cells touch at corners alone, keeps a path over 4 neighbours out."""
    source = Frame(40, 40, 0.05, (-1.0, -1.0, math.pi / 4))
    found = obstacles_in(Frame(60, 60, 0.05, (-1.5, -1.0, 0.0)), np.eye(40, dtype=bool), source)
    column = np.flatnonzero(found.any(axis=0))
    rows = np.flatnonzero(found.any(axis=1))
    assert len(column) <= 4  # the wall points north
    assert np.all(np.diff(rows) == 1)


@pytest.mark.slow
@given(
    shapes=st.tuples(*[st.integers(1, 6)] * 4), resolutions=st.tuples(RESOLUTIONS, RESOLUTIONS),
    yaws=st.tuples(YAWS, YAWS), shift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    seed=st.integers(0, 999),
)  # fmt: skip
@settings(deadline=None)
def test_a_cell_lies_wholly_in_those_that_take_all_of_its_area(
    shapes, resolutions, yaws, shift, seed
):
    frame = Frame(*shapes[:2], resolutions[0], (-1.5, 2.0, yaws[0]))
    source = Frame(*shapes[2:], resolutions[1], (-1.5 + shift[0], 2.0 + shift[1], yaws[1]))
    cells = np.random.default_rng(seed).random(source.shape) < 0.8
    found = wholly_in(frame, cells, source)
    taken = [corners(source, *cell) for cell in np.argwhere(cells)]
    for cell in np.ndindex(frame.shape):
        area = sum(shared_area(corners(frame, *cell), one) for one in taken)
        missing = resolutions[0] ** 2 - area
        if found[cell]:
            assert missing < 1e-4 * resolutions[0] ** 2
        else:
            assert missing > 1e-14 * resolutions[0] ** 2


def test_cells_of_the_same_lattice_are_wholly_in_what_they_are():
    known = np.random.default_rng(1).random((9, 14)) < 0.3
    source = Frame(9, 14, 0.05, (0.1, -2.0, 0.3))
    found = wholly_in(source.window(-2, 5, 8, 20), known, source)
    expected = np.zeros((8, 20), bool)
    expected[2:, :9] = known[:6, 5:]
    np.testing.assert_array_equal(found, expected)


def test_cells_of_many_bands_are_looked_at_once():
    """A fine grid of more cells than are looked at together, by coarse cells."""
    fine = Frame(700, 900, 0.01, (0.005, -0.005, 0.2))
    obstacles = np.zeros(fine.shape, bool)
    places = [(0, 0), (699, 899), (333, 7), (72, 899)]
    for row, col in places:
        obstacles[row, col] = True
    coarse = Frame(40, 50, 0.3, (-2.0, -1.0, 0.0))
    found = obstacles_in(coarse, obstacles, fine)
    for row, col in places:
        middle = fine.xy_from_rowcol([[row, col]])
        assert found[tuple(coarse.unbounded_rowcol_from_xy(middle)[0])]
    assert found.sum() <= 4 * len(places)


def largest_by_areas(frame, values, source, cell, threshold):
    """The largest value above 0 that a cell shares more than an area with, by clipping."""
    own = corners(frame, *cell)
    shared = (
        int(values[one])
        for one in np.ndindex(source.shape)
        if values[one] > 0 and shared_area(own, corners(source, *one)) > threshold
    )
    return max(shared, default=0)


def value_at(values, source, x, y, margin):
    """The value at a point by plain trigonometry, -1 outside; None within a margin of a border."""
    dx, dy = x - source.origin[0], y - source.origin[1]
    cos, sin = math.cos(source.origin[2]), math.sin(source.origin[2])
    col, row = (dx * cos + dy * sin, dy * cos - dx * sin)
    col, row = col / source.resolution, row / source.resolution
    if min(abs(place - round(place)) for place in (row, col)) < margin:
        return None
    row, col = math.floor(row), math.floor(col)
    inside = 0 <= row < source.height and 0 <= col < source.width
    return int(values[row, col]) if inside else -1


@pytest.mark.slow
@given(
    shapes=st.tuples(*[st.integers(1, 7)] * 4), resolutions=st.tuples(RESOLUTIONS, RESOLUTIONS),
    yaws=st.tuples(YAWS, YAWS), shift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    seed=st.integers(0, 999), far=st.sampled_from([0.0, 5e6]),
)  # fmt: skip
@settings(deadline=None)
def test_values_are_the_largest_overlapped_or_those_at_the_centre(
    shapes, resolutions, yaws, shift, seed, far
):
    frame = Frame(*shapes[:2], resolutions[0], (far - 1.5, 2.0, yaws[0]))
    source = Frame(*shapes[2:], resolutions[1], (far - 1.5 + shift[0], 2.0 + shift[1], yaws[1]))
    choices = np.array([-1, 0, 0, 0, 1, 30, 99, 100], np.int8)
    values = np.random.default_rng(seed).choice(choices, source.shape)
    grid = OccupancyGrid(values, source.resolution, source.origin)
    found, nearest = (resampled(grid, frame, rule=rule) for rule in ("area", "nearest"))
    assert found.frame == nearest.frame == frame
    cell_area = min(resolutions) ** 2
    for cell in np.ndindex(frame.shape):
        at_least = largest_by_areas(frame, values, source, cell, 1e-5 * cell_area)
        at_most = largest_by_areas(frame, values, source, cell, 1e-14 * cell_area)
        value = found.occupancy[cell]
        assert at_least <= max(value, 0)
        if not far:
            assert max(value, 0) <= at_most
        (x, y) = np.mean(corners(frame, *cell), axis=0)
        centre = value_at(values, source, x, y, 1e-6)
        if centre is not None:
            assert nearest.occupancy[cell] == centre
            if value <= 0:
                assert value == min(centre, 0)


@pytest.mark.parametrize("quarters", range(-3, 5))
def test_quarter_turns_are_permutations_of_cells(quarters):
    values = np.random.default_rng(2).choice(np.array([-1, 0, 40, 100], np.int8), (5, 9))
    grid = OccupancyGrid(values, 0.05, (7.3, -2.15, 0.4))
    height, width = np.rot90(values, quarters).shape
    corner = {0: (0, 0), 1: (0, 9), 2: (5, 9), 3: (5, 0)}[quarters % 4]
    x, y = grid.frame.xy_from_continuous_rowcol([corner])[0]
    frame = Frame(height, width, 0.05, (x, y, 0.4 + quarters * math.pi / 2))
    for rule in ("area", "nearest"):
        found = resampled(grid, frame, rule=rule)
        np.testing.assert_array_equal(found.occupancy, np.rot90(values, quarters))


def test_costs_are_resampled_on_both_scales():
    cost = np.array([[0, 255, 1, 254], [255, 255, 253, 255]], np.uint8)
    costmap = Costmap(cost, 0.1, (0.5, 0.5, 0.0), circumscribed_cost=80)
    coarse = resampled(costmap, Frame(1, 3, 0.2, (0.5, 0.5, 0.0)))
    assert coarse.cost.tolist() == [[255, 254, 255]]
    assert coarse.cost.dtype == np.uint8
    assert (coarse.scale, coarse.circumscribed_cost) == ("costmap2d", 80)
    shares = Costmap(np.array([[-1, 100, 3, 0]], np.int8), 0.1, scale="occupancy")
    found = resampled(shares, Frame(1, 3, 0.1, (0.05, 0.02, 0.0)))
    assert found.cost.tolist() == [[100, 100, 3]]
    assert found.scale == "occupancy"


@pytest.mark.parametrize("side", [0.3, 1.0, 1.9, 2.1, 7.3])
def test_every_point_of_an_obstacle_lies_in_one_as_large(side):
    """Random points, on lattices from finer to much coarser."""
    rng = np.random.default_rng(7)
    values = rng.choice(np.array([-1, 0, 0, 0, 0, 0, 50, 100], np.int8), (53, 37))
    grid = OccupancyGrid(values, 0.1, (-3.0, 11.0, 0.7))
    count = math.ceil(100 / side)
    frame = Frame(count, count, 0.1 * side, (-8.0, 8.0, 0.31))
    found = resampled(grid, frame)
    places = rng.random((20000, 2)) * values.shape
    then, inside = frame.bounded_rowcol_from_xy(grid.frame.xy_from_continuous_rowcol(places))
    assert inside.all()
    before = values[tuple(np.floor(places).astype(int).T)]
    after = found.occupancy[tuple(then.T)]
    assert (after >= before)[before > 0].all()


def test_free_and_unknown_keep_their_shares():
    """Single unknown cells in free space, on a lattice turned by 3 degrees."""
    values = np.where(np.random.default_rng(3).random((200, 300)) < 0.1, -1, 0).astype(np.int8)
    grid = OccupancyGrid(values, 0.05, (1.0, 2.0, 0.0))
    frame = Frame(180, 270, 0.05, (1.4, 2.2, math.radians(3)))
    found = resampled(grid, frame)
    assert abs((found.occupancy == -1).mean() - 0.1) < 0.01


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_and_bands_make_no_difference(threads):
    values = np.random.default_rng(4).choice(np.array([-1, 0, 100], np.int8), (700, 600))
    grid = OccupancyGrid(values, 0.05, (1.0, 2.0, 0.0))
    frame = Frame(800, 700, 0.05, (1.4, -2.2, 0.5))
    with use_threads(threads):
        whole = resampled(grid, frame).occupancy
    for row in (0, 417, 799):
        one = resampled(grid, frame.window(row, 0, 1, 700)).occupancy
        np.testing.assert_array_equal(one[0], whole[row])


def test_a_frame_beside_the_grid_is_unknown():
    grid = OccupancyGrid([[100, 0]], 0.5, (3.0, 3.0, 0.2))
    assert (resampled(grid, Frame(2, 3, 0.1, (90.0, 0.0, 0.0))).occupancy == -1).all()


def test_there_are_two_rules():
    grid = OccupancyGrid([[100, 0]], 0.5)
    with pytest.raises(ParameterError, match="rule: must be one of area, nearest, got 'median'"):
        resampled(grid, grid.frame, rule="median")
