"""Keepout masks against Nav2's rule, cell by cell in the map frame."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import Costmap, MapdealWarning, OccupancyGrid, apply_keepout_mask

ORIGIN = (1.0, 2.0, 0.3)


def by_hand(costmap, mask):
    """The keepout rule, one cell after the other."""
    result = costmap.cost.astype(int)
    unknown = 255 if costmap.scale == "costmap2d" else -1
    for row, col in np.ndindex(costmap.shape):
        centre = costmap.frame.xy_from_rowcol([[row, col]])
        cells, inside = mask.frame.bounded_rowcol_from_xy(centre)
        if not inside[0]:
            continue
        value = int(mask.occupancy[tuple(cells[0])])
        if value == -1:
            continue
        if costmap.scale == "costmap2d":
            value = int(value * 254 / 100 + 0.5)
        if value > result[row, col] or result[row, col] == unknown:
            result[row, col] = value
    return result


def covered(costmap, mask):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        return apply_keepout_mask(costmap, mask)


def test_every_pair_of_cost_and_mask_value():
    costs = np.tile(np.arange(256, dtype=np.uint8), (102, 1))
    values = np.repeat(np.arange(-1, 101, dtype=np.int8)[:, np.newaxis], 256, axis=1)
    costmap = Costmap(costs, 0.5, ORIGIN, circumscribed_cost=30)
    result = covered(costmap, OccupancyGrid(values, 0.5, ORIGIN))
    mask = np.array([-1, *[int(v * 254 / 100 + 0.5) for v in range(101)]])[:, np.newaxis]
    expected = np.where((mask >= 0) & ((mask > costs) | (costs == 255)), mask, costs)
    assert np.array_equal(result.cost, expected)
    assert (result.scale, result.origin, result.circumscribed_cost) == ("costmap2d", ORIGIN, 30)


@pytest.mark.slow
@pytest.mark.parametrize("scale", ["costmap2d", "occupancy"])
@pytest.mark.parametrize("turn", [0.0, 0.5])
@given(
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
    resolution=st.sampled_from([0.25, 0.5, 0.17, 2.0]),
    seed=st.integers(0, 999),
)
def test_a_mask_of_any_geometry(scale, turn, x, y, resolution, seed):
    rng = np.random.default_rng(seed)
    values = rng.choice(np.array([-1, 0, 37, 100], np.int8), (7, 9))
    if scale == "costmap2d":
        costs = rng.integers(0, 256, (5, 8)).astype(np.uint8)
    else:
        costs = rng.integers(-1, 101, (5, 8)).astype(np.int8)
    costmap = Costmap(costs, 0.5, ORIGIN, scale)
    mask = OccupancyGrid(values, resolution, (1.0 + x, 2.0 + y, 0.3 + turn))
    assert np.array_equal(covered(costmap, mask).cost, by_hand(costmap, mask))


def test_a_mask_that_misses_the_map_is_warned_of():
    costmap = Costmap([[0, 9]], 0.5, ORIGIN)
    with pytest.warns(MapdealWarning, match="covers no cell"):
        result = apply_keepout_mask(costmap, OccupancyGrid([[100]], 0.5, (50.0, 2.0, 0.0)))
    assert result.cost.tolist() == [[0, 9]]


def test_unknown_cells_that_become_free_are_counted():
    costmap = Costmap([[255, 255, 255, 0]], 0.5, ORIGIN)
    mask = OccupancyGrid([[0, 0, 100, 0]], 0.5, ORIGIN)
    with pytest.warns(MapdealWarning, match="2 unknown cells"):
        result = apply_keepout_mask(costmap, mask)
    assert result.cost.tolist() == [[0, 0, 254, 0]]
