import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles
from mapdeal import Costmap, Frame, OccupancyGrid
from mapdeal.grid.canvas import obstacles_in, resampled, wholly_in
from mapdeal.kernels.threads import use_threads


def corners(frame, row, col):
    places = [[row, col], [row, col + 1], [row + 1, col + 1], [row + 1, col]]
    return [tuple(p) for p in frame.xy_from_continuous_rowcol(places).tolist()]


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
        area = max((oracles.shared_area(corners(frame, *cell), one) for one in taken), default=0.0)
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
        area = sum(oracles.shared_area(corners(frame, *cell), one) for one in taken)
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


def largest_by_areas(frame, values, source, cell, threshold):
    """The largest value above 0 that a cell shares more than an area with, by clipping."""
    own = corners(frame, *cell)
    shared = (
        int(values[one])
        for one in np.ndindex(source.shape)
        if values[one] > 0 and oracles.shared_area(own, corners(source, *one)) > threshold
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
