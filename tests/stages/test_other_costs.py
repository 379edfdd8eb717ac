import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from mapdeal import Costmap, MapdealWarning, OccupancyGrid, esdf, ring_cost, threshold_cost
from strategies import occupancies

PLACE = (1.0, 2.0, 0.3)
THRESHOLDS = st.integers(0, 100) | st.integers(0, 40).map(lambda cells: f"{cells / 20:.2f}")


@given(
    occupancies(), st.sampled_from([0.04, 0.05, 0.1, 0.15, 0.25]),
    st.sampled_from(["metric", "per-map"]),
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
    except mapdeal.ParameterError as error:
        assert "up" in str(error)  # in the wrong order
        assume(False)
    make = oracles.metric_view if view == "metric" else oracles.per_map_view
    more = {"view_range": 2.0} if view == "metric" else {}
    values = make(occupancy, occupied, resolution, strength=strength, **more)
    squared = oracles.squared_distance(occupied)
    limits = {"down": down, "up": up, "factors": factors}
    expected = oracles.threshold_cost(values, squared, resolution, strength, **limits)
    assert np.array_equal(found, expected)


def test_a_view_gives_the_costs_of_its_field():
    grid = OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
    field = esdf(grid, strength=1.3)
    for view in ("metric", "per-map"):
        shown = mapdeal.field_view(field, view=view, view_range=1.5)
        # metres that are multiples of the cells; of others a view has no more than its steps
        for more in ({}, {"down_distance": 0.65, "up_distance": 0.325, "down_factor": 0.4}):
            options = {"view": view, "view_range": 1.5, **more}
            expected, found = threshold_cost(field, **options), threshold_cost(shown, **options)
            assert np.array_equal(found.cost, expected.cost)
            assert (found.origin, found.scale) == (expected.origin, expected.scale)


def test_what_of_a_field_or_a_view_does_not_count_is_warned_of():
    grid = grid_from_text("#...", 0.25)
    view = mapdeal.field_view(esdf(grid), view_range=1.0)
    with pytest.warns(MapdealWarning, match="a view already, metric, 0 at 1 m"):
        assert threshold_cost(view, view_range=2.0).cost.tolist() == [[100, 99, 0, 0]]
    for model in (mapdeal.exponential_cost, ring_cost):
        with pytest.warns(MapdealWarning, match=r"no account of the field's strength, 1\.5"):
            found = model(esdf(grid, strength=1.5))
        assert np.array_equal(found.cost, model(esdf(grid)).cost)  # no warning here


@pytest.mark.parametrize(("clip", "strength", "options", "is_refused"), [
    # the view is 46 at 1.07 m and 43 at 1.13 m
    (1.07, 1.0, {}, True), (1.13, 1.0, {}, False), (1.13, 1.0, {"down": 42}, True),
    (0.6, 2.0, {}, False),  # doubled, 1.2 m: the view there is 40, below down
    (1.2, 0.5, {}, True),  # halved, 0.6 m
    (1.5, 1.0, {"view": "per-map"}, True), (9.0, 1.0, {"view": "per-map"}, False),
], ids=str)  # fmt: skip
def test_a_field_may_be_clipped_where_costs_no_longer_fall(clip, strength, options, is_refused):
    cells = OccupancyGrid([[100] + [0] * 19], 0.1)
    field = esdf(cells, max_distance=clip, strength=strength)
    if is_refused:
        with pytest.raises(mapdeal.ParameterError, match=r"max_distance: .*view still falls"):
            threshold_cost(field, **options)
        return
    expected = threshold_cost(esdf(cells, strength=strength), **options).cost
    assert np.array_equal(threshold_cost(field, **options).cost, expected)


@given(occupancies(), st.lists(st.integers(0, 100), min_size=1, max_size=4), st.booleans())
def test_rings_equal_brute_force(occupancy, values, is_field):
    grid = OccupancyGrid(occupancy, 0.3)
    inner = (occupancy == 100) | ((occupancy == -1) & is_field)
    expected, obstacles = np.where(inner, 100, occupancy), inner
    for reach, value in enumerate(values, 1):
        outer = oracles.square_inflation(obstacles, reach)
        expected[outer & ~inner] = value
        inner = outer
    source = esdf(grid, unknown="occupied") if is_field else grid
    assert np.array_equal(ring_cost(source, values=values).cost, expected)


def by_hand(costmap, mask):
    """The keepout rule, one cell after the other."""
    result = costmap.cost.astype(int)
    unknown = 255 if costmap.scale == "costmap2d" else -1
    for row, col in np.ndindex(costmap.shape):
        centre = costmap.frame.xy_from_rowcol([[row, col]])
        (cell,), (inside,) = mask.frame.bounded_rowcol_from_xy(centre)
        value = int(mask.occupancy[tuple(cell)]) if inside else -1
        if value > -1 and costmap.scale == "costmap2d":
            value = int(value * 254 / 100 + 0.5)
        if value > -1 and (value > result[row, col] or result[row, col] == unknown):
            result[row, col] = value
    return result


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@given(
    x=st.floats(-3, 3), y=st.floats(-3, 3), resolution=st.sampled_from([0.25, 0.5, 0.17, 2.0]),
    seed=st.integers(0, 999), scale=st.sampled_from(["costmap2d", "occupancy"]),
    turn=st.sampled_from([0.0, 0.5]),
)  # fmt: skip
def test_a_mask_of_any_geometry(scale, turn, x, y, resolution, seed):
    rng = np.random.default_rng(seed)
    values = rng.integers(-1, 101, (7, 9)).astype(np.int8)
    is_ros = scale == "costmap2d"
    costs = rng.integers(0, 256, (5, 8)) if is_ros else rng.integers(-1, 101, (5, 8))
    costmap = Costmap(costs, 0.5, PLACE, scale, circumscribed_cost=30 if is_ros else None)
    mask = OccupancyGrid(values, resolution, (1.0 + x, 2.0 + y, 0.3 + turn))
    result = mapdeal.apply_keepout_mask(costmap, mask)
    assert np.array_equal(result.cost, by_hand(costmap, mask))
    for name in ("scale", "origin", "circumscribed_cost"):
        assert getattr(result, name) == getattr(costmap, name)


@pytest.mark.parametrize(("place", "message", "expected"), [
    (PLACE, "2 unknown cells", [0, 0, 254, 0]),  # which become free
    ((50.0, 2.0, 0.0), "covers no cell", [255, 255, 255, 0]),
])  # fmt: skip
def test_masks_that_free_cells_or_miss_the_map_are_warned_of(place, message, expected):
    costmap = Costmap([[255, 255, 255, 0]], 0.5, PLACE)
    with pytest.warns(MapdealWarning, match=message):
        result = mapdeal.apply_keepout_mask(costmap, OccupancyGrid([[0, 0, 100, 0]], 0.5, place))
    assert result.cost.tolist() == [expected]
