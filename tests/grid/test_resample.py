import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from mapdeal import Costmap, Frame, OccupancyGrid
from mapdeal.grid.canvas import contained_in, obstacles_in, resampled
from mapdeal.kernels.threads import use_threads


def corners(frame, row, col):
    places = [[row, col], [row, col + 1], [row + 1, col + 1], [row + 1, col]]
    return [tuple(p) for p in frame.xy_from_continuous_rowcol(places).tolist()]


YAWS = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi, math.pi / 4]), st.floats(-4, 4))
RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.025, 0.07, 0.3])
SHIFTS = st.floats(-0.4, 0.4)


@st.composite
def lattices(draw):
    """Return a frame and another one that lies about there, and how far away both are."""
    far = draw(st.sampled_from([0.0, 0.0, 5e6]))
    shapes = draw(st.tuples(*[st.integers(1, 6)] * 4))
    origin = (far - 1.5, 2.0, draw(YAWS))
    far_origin = (far - 1.5 + draw(SHIFTS), 2.0 + draw(SHIFTS), draw(YAWS))
    frame = Frame(*shapes[:2], draw(RESOLUTIONS), origin)
    return frame, Frame(*shapes[2:], draw(RESOLUTIONS), far_origin), far


@pytest.mark.slow
@given(lattices(), st.integers(0, 999))
def test_cells_have_what_shares_area_with_them_or_what_is_at_their_centre(drawn, seed):
    frame, source, far = drawn
    choices = np.array([-1, 0, 0, 0, 1, 30, 99, 100], np.int8)
    values = np.random.default_rng(seed).choice(choices, source.shape)
    grid = OccupancyGrid(values, source.resolution, source.origin)
    found, nearest = (resampled(grid, frame, rule=rule) for rule in ("area", "nearest"))
    assert found.frame == nearest.frame == frame
    has_obstacle = obstacles_in(frame, values > 0, source)
    is_known = contained_in(frame, values >= 0, source)
    smallest = min(frame.resolution, source.resolution) ** 2
    source_cells = [
        (int(values[cell]), corners(source, *cell)) for cell in np.ndindex(source.shape)
    ]
    for cell in np.ndindex(frame.shape):
        own = corners(frame, *cell)
        shared = [
            (value, oracles.shared_area(own, cell_corners)) for value, cell_corners in source_cells
        ]
        at_least = max((v for v, area in shared if area > 1e-5 * smallest and v > 0), default=0)
        at_most = max((v for v, area in shared if area > 1e-14 * smallest and v > 0), default=0)
        value = int(found.occupancy[cell])
        assert at_least <= max(value, 0)
        assert has_obstacle[cell] or not at_least
        if not far:
            assert max(value, 0) <= at_most
            assert at_most or not has_obstacle[cell]
            missing = frame.resolution**2 - sum(area for v, area in shared if v >= 0)
            if is_known[cell]:
                assert missing < 1e-4 * frame.resolution**2
            else:
                assert missing > 1e-14 * frame.resolution**2
        centre = oracles.value_at(grid, np.mean(own, axis=0), 1e-6)
        if centre is not None:
            assert nearest.occupancy[cell] == centre
            if value <= 0:
                assert value == min(centre, 0)


@pytest.mark.parametrize("far", [0.0, 3e5])
@pytest.mark.parametrize("function", [obstacles_in, contained_in])
def test_cells_of_the_same_lattice_are_copied(function, far):
    mask = np.random.default_rng(1).random((9, 14)) < 0.3
    source = Frame(9, 14, 0.05, (far + 0.1, -2.0, 0.3))
    expected = np.zeros((8, 20), bool)
    expected[2:, :9] = mask[:6, 5:]
    np.testing.assert_array_equal(function(source.window(-2, 5, 8, 20), mask, source), expected)


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


def test_costs_are_resampled_on_both_scales():
    cost = np.array([[0, 255, 1, 254], [255, 255, 253, 255]], np.uint8)
    costmap = Costmap(cost, 0.1, (0.5, 0.5, 0.0), circumscribed_cost=80)
    coarse = resampled(costmap, Frame(1, 3, 0.2, (0.5, 0.5, 0.0)))
    assert coarse.cost.tolist() == [[255, 254, 255]]
    assert (coarse.scale, coarse.circumscribed_cost) == ("costmap2d", 80)
    shares = Costmap(np.array([[-1, 100, 3, 0]], np.int8), 0.1, scale="occupancy")
    found = resampled(shares, Frame(1, 3, 0.1, (0.05, 0.02, 0.0)))
    assert (found.cost.tolist(), found.scale) == ([[100, 100, 3]], "occupancy")
    assert (resampled(shares, Frame(2, 3, 0.1, (90.0, 0.0, 0.0))).cost == -1).all()


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_and_bands_make_no_difference(threads):
    values = np.random.default_rng(4).choice(np.array([-1, 0, 100], np.int8), (700, 600))
    grid = OccupancyGrid(values, 0.05, (1.0, 2.0, 0.0))
    frame = Frame(800, 700, 0.05, (1.4, -2.2, 0.5))
    with use_threads(threads):
        at_once = resampled(grid, frame).occupancy
    for row in (0, 417, 799):
        single_row = resampled(grid, frame.window(row, 0, 1, 700)).occupancy
        np.testing.assert_array_equal(single_row[0], at_once[row])
