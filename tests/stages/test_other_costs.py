import functools
import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import (
    Costmap,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    apply_keepout_mask,
    esdf,
    exponential_cost,
    field_view,
    ring_cost,
    threshold_cost,
)
from strategies import occupancies

THRESHOLDS = st.integers(0, 100) | st.integers(0, 40).map(lambda cells: f"{cells / 20:.2f}")


@given(
    occupancies(), st.sampled_from([0.04, 0.05, 0.1, 0.25]), st.sampled_from(["metric", "per-map"]),
    THRESHOLDS, THRESHOLDS, st.sampled_from([0.5, 1.0, 1.5]),
    st.sampled_from([(0.0, 1.5), (0.3, 1.1), (0.58, 0.07)]),
)  # fmt: skip
def test_threshold_costs_equal_brute_force_on_paper(
    occupancy, resolution, view, down, up, strength, factors
):
    """Thresholds are values of the view, or metres, as text; products of 0.58 are 29 of 50."""
    occupied = occupancy >= 100
    field = esdf(OccupancyGrid(occupancy, resolution, (0.5, -2.0, 1.0)), strength=strength)
    options = {"down_factor": factors[0], "up_factor": factors[1], "view": view}
    for name, value in (("down", down), ("up", up)):
        options |= {f"{name}_distance": float(value)} if isinstance(value, str) else {name: value}
    try:
        found = threshold_cost(field, **options).cost
    except ParameterError as error:
        assert "up" in str(error)  # in the wrong order
        assume(False)
    make = {"metric": functools.partial(oracles.metric_view, view_range=2.0)}
    values = make.get(view, oracles.per_map_view)(
        occupancy, occupied, resolution, strength=strength
    )  # fmt: skip
    squared = oracles.squared_distance(occupied)
    expected = oracles.threshold_cost(
        values, squared, resolution, strength, down=down, up=up, factors=factors
    )  # fmt: skip
    assert np.array_equal(found, expected)


def test_a_view_gives_the_costs_of_its_field():
    grid = OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
    field = esdf(grid, strength=1.3)
    for view in ("metric", "per-map"):
        made = field_view(field, view=view, view_range=1.5)
        # metres that are multiples of the cells; of others a view has no more than its steps
        for more in ({}, {"down_distance": 0.65, "up_distance": 0.325, "down_factor": 0.4}):
            options = {"view": view, "view_range": 1.5, **more}
            expected = threshold_cost(field, **options)
            found = threshold_cost(made, **options)
            assert np.array_equal(found.cost, expected.cost)
            assert (found.origin, found.scale) == (expected.origin, expected.scale)


def test_a_view_is_taken_as_it_is_and_says_so():
    made = field_view(esdf(grid_from_text("#...", 0.25)), view_range=1.0)
    with pytest.warns(MapdealWarning, match="a view already, metric, 0 at 1 m"):
        assert threshold_cost(made, view_range=2.0).cost.tolist() == [[100, 99, 0, 0]]


@pytest.mark.parametrize("model", [exponential_cost, ring_cost])
def test_models_that_ignore_the_strength_warn(model):
    grid = grid_from_text("#...")
    with pytest.warns(MapdealWarning, match=r"no account of the field's strength, 1\.5"):
        found = model(esdf(grid, strength=1.5))
    assert np.array_equal(found.cost, model(esdf(grid)).cost)  # no warning here


def test_a_clip_counts_with_the_strength():
    grid = OccupancyGrid([[100] + [0] * 19], 0.1)
    # clipped at 0.6 m, which doubled is 1.2 m: the view there is 40, below down
    whole = threshold_cost(esdf(grid, strength=2.0)).cost
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=0.6, strength=2.0)).cost, whole)
    with pytest.raises(ParameterError, match="max_distance"):  # 1.2 m, which halved is 0.6 m
        threshold_cost(esdf(grid, max_distance=1.2, strength=0.5))


@given(occupancies(), st.lists(st.integers(0, 100), min_size=1, max_size=4))
def test_rings_equal_brute_force(occupancy, values):
    inner = occupancy >= 100
    expected = occupancy.copy()
    for reach, value in enumerate(values, 1):
        outer = oracles.square_inflation(occupancy >= 100, reach)
        expected[outer & ~inner] = value
        inner = outer
    assert np.array_equal(ring_cost(OccupancyGrid(occupancy, 0.3), values=values).cost, expected)


def test_rings_of_a_field_take_its_obstacles():
    field = esdf(grid_from_text("#...?"), unknown="occupied")
    assert ring_cost(field, values=(80,)).cost.tolist() == [[100, 80, 0, 80, 100]]


def test_a_field_clipped_where_costs_still_fall_is_refused():
    grid = OccupancyGrid([[100] + [0] * 9], 0.25)
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(esdf(grid, max_distance=1.0))  # the view there is 50, above down
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(esdf(grid, max_distance=1.5), view="per-map")
    whole = threshold_cost(esdf(grid)).cost
    # At 1.25 m the view is 37: beyond it everything costs 0, clipped or not.
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=1.25)).cost, whole)
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=9.0), view="per-map").cost,
                          threshold_cost(esdf(grid), view="per-map").cost)  # fmt: skip


@pytest.mark.parametrize(("max_distance", "is_refused"), [(1.07, True), (1.13, False)])
def test_a_clip_may_lie_where_the_view_is_down_at_most(max_distance, is_refused):
    # the view is 46 at 1.07 m and 43 at 1.13 m
    field = esdf(OccupancyGrid([[100] + [0] * 19], 0.1), max_distance=max_distance)
    if is_refused:
        with pytest.raises(ParameterError, match="the metric view still falls"):
            threshold_cost(field)
    else:
        threshold_cost(field)
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(field, down=42)


@pytest.mark.parametrize(("cells", "view_range"), [(6, 1.0), (12, 2.0), (18, 3.0)])
def test_a_cell_as_far_as_the_threshold_is_not_lost_to_rounding(cells, view_range):
    grid = OccupancyGrid([[100, *[0] * 20]], 0.15, (0.5, -2.0, 1.0))
    distance = float(f"{0.15 * cells:.2f}")  # which 0.15 times the number of cells is not
    found = threshold_cost(grid, down_distance=distance, up_distance=0.0, down_factor=1.0,
                           view_range=view_range).cost[0]  # fmt: skip
    assert found[cells - 1] > 0
    assert not found[cells:].any()


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
    x=st.floats(-3, 3), y=st.floats(-3, 3), resolution=st.sampled_from([0.25, 0.5, 0.17, 2.0]),
    seed=st.integers(0, 999),
)  # fmt: skip
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
