"""Rescaled maps against numpy's repeat and loops in plain Python."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import Costmap, OccupancyGrid, ParameterError, esdf, rescale

CHOICES = np.array([-1, 0, 0, 0, 30, 100], np.int8)
ORIGIN = (1.3, -2.6, 0.4)


def some_map(seed, height, width, resolution="0.05"):
    values = np.random.default_rng(seed).choice(CHOICES, (height, width))
    return OccupancyGrid(values, float(resolution), ORIGIN)


def rescaled_by_hand(values, ratio):
    """In fractions: the largest above 0 that is overlapped, else what is at the centre."""
    height, width = (math.ceil(Fraction(size) / ratio) for size in values.shape)
    result = np.full((height, width), -1, np.int8)
    for row, col in np.ndindex(height, width):
        under = values[
            math.floor(row * ratio) : math.ceil((row + 1) * ratio),
            math.floor(col * ratio) : math.ceil((col + 1) * ratio),
        ]
        at = tuple(math.floor((k + Fraction(1, 2)) * ratio) for k in (row, col))
        inside = at[0] < values.shape[0] and at[1] < values.shape[1]
        result[row, col] = under.max() if under.max() > 0 else values[at] if inside else -1
    return result


@given(
    seed=st.integers(0, 999), height=st.integers(1, 12), width=st.integers(1, 12),
    old=st.sampled_from(["0.05", "0.1", "0.07", "0.25"]),
    new=st.sampled_from(["0.05", "0.1", "0.2", "0.03", "0.15", "1", "0.35"]),
)  # fmt: skip
@settings(deadline=None)
def test_every_cell_is_as_by_hand(seed, height, width, old, new):
    grid = some_map(seed, height, width, old)
    result = rescale(grid, float(new))
    assert (result.resolution, result.origin) == (float(new), ORIGIN)
    np.testing.assert_array_equal(
        result.occupancy, rescaled_by_hand(grid.occupancy, Fraction(new) / Fraction(old))
    )


@pytest.mark.parametrize("factor", [2, 3, 5])
@pytest.mark.parametrize("rule", ["area", "nearest"])
def test_finer_by_a_whole_factor_repeats_cells(factor, rule):
    grid = some_map(1, 7, 11, "0.1")
    result = rescale(grid, 0.1 / factor, rule=rule)
    expected = np.repeat(np.repeat(grid.occupancy, factor, axis=0), factor, axis=1)
    np.testing.assert_array_equal(result.occupancy, expected)
    back = rescale(result, 0.1, rule=rule)
    np.testing.assert_array_equal(back.occupancy, grid.occupancy)


def test_coarser_by_the_nearest_rule_takes_every_third_cell():
    grid = some_map(2, 9, 12)
    result = rescale(grid, 0.15, rule="nearest")
    np.testing.assert_array_equal(result.occupancy, grid.occupancy[1::3, 1::3])


def test_the_same_resolution_is_the_same_grid():
    grid = some_map(3, 4, 5)
    assert rescale(grid, 0.05) is grid


def test_unknown_costs_never_win():
    costs = np.array([[255, 0, 255, 254], [0, 0, 9, 255]], np.uint8)
    result = rescale(Costmap(costs, 0.1, ORIGIN), 0.2)
    assert result.cost.tolist() == [[0, 254]]


@pytest.mark.parametrize("resolution", [math.nan, 0, -0.1, math.inf])
def test_a_resolution_is_a_length(resolution):
    with pytest.raises(ParameterError, match="resolution"):
        rescale(some_map(1, 3, 4), resolution)


def test_bad_calls():
    with pytest.raises(ParameterError, match="rule"):
        rescale(some_map(1, 3, 4), 0.05, rule="median")
    with pytest.raises(ParameterError, match=r"resolution: .*1000000000 cells"):
        rescale(some_map(1, 100, 100), 1e-5)
    with pytest.raises(ParameterError, match="a map or a costmap"):
        rescale(esdf(some_map(3, 5, 6)), 0.1)
