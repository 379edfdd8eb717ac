import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from mapdeal import Costmap, OccupancyGrid
from mapdeal.grid.values import (
    cost_from_occupancy,
    occupancy_from_cost,
    static_layer_cost_from_occupancy,
)


def test_a_costmap_becomes_the_occupancy_that_ros_would_publish():
    costmap = Costmap([[0, 1, 128], [253, 254, 255]], 0.2, (1.0, 2.0, 0.5))
    grid = costmap.to_occupancy()
    assert grid.occupancy.tolist() == [[0, 1, 50], [99, 100, -1]]
    assert (grid.resolution, grid.origin) == (0.2, (1.0, 2.0, 0.5))


def test_figures_count_each_cell_once():
    costmap = Costmap([[0, 0, 0, 1, 252], [253, 253, 254, 255, 7]], 0.5, circumscribed_cost=61)
    assert costmap.figures() == {
        "width": 5, "height": 2, "resolution": 0.5, "origin": [0.0, 0.0, 0.0],
        "cost_scale": "costmap2d", "free": 3, "lethal": 1, "inscribed": 2, "unknown": 1,
        "circumscribed_cost": 61, "graded": 3, "most_common": {"cost": 0, "share": 0.5},
    }  # fmt: skip
    published = Costmap([[0, 0, 0, 1, 99], [100, 100, 98, -1, 7]], 0.5, scale="occupancy")
    figures = published.figures()
    names = ("free", "lethal", "unknown", "graded")
    assert [figures[name] for name in names] == [3, 2, 1, 4]
    assert "inscribed" not in figures


@pytest.fixture(scope="module")
def peers(real_maps):
    with np.load(real_maps / "expected" / "peers.npz") as file:
        yield file


@given(st.integers(0, 100), st.none() | st.integers(0, 100), st.booleans(), st.booleans())
def test_costs_of_static_layers_are_those_of_interpret_value(
    threshold, inscribed, trinary, track_unknown
):
    grid = OccupancyGrid([range(-1, 101)], 0.2, (1.0, 2.0, 0.5))
    rules = {"trinary": trinary, "track_unknown": track_unknown}
    costs = Costmap.from_static_layer(
        grid, lethal_threshold=threshold, inscribed_value=inscribed, **rules
    )
    assert costs.cost[0].tolist() == [
        oracles.static_layer_cost(value, threshold, inscribed=inscribed, **rules)
        for value in range(-1, 101)
    ]
    assert (costs.scale, costs.origin) == ("costmap2d", grid.origin)


@pytest.mark.parametrize(
    ("name", "options"),
    [("trinary", {}), ("scaled", {"trinary": False}), ("no_unknown", {"track_unknown": False})],
)
def test_the_static_layer_reads_every_byte_as_ros_does(peers, name, options):
    values = peers["occ_values"][0]
    assert sorted(values.tolist()) == list(range(-128, 128))
    table = static_layer_cost_from_occupancy(**options)
    assert np.array_equal(table[values.view(np.uint8)], peers[f"static/{name}"][0])


def test_costs_are_published_and_masks_become_costs_as_in_ros(peers):
    assert np.array_equal(occupancy_from_cost(), peers["to_occ"][0])
    values = np.arange(-1, 101, dtype=np.int8)
    assert np.array_equal(cost_from_occupancy()[values.view(np.uint8)], peers["from_occ"][0])


def test_masks_of_a_map():
    grid = OccupancyGrid([[-1, 0, 1], [50, 99, 100]], 0.05)
    assert grid.unknown().tolist() == [[True, False, False], [False, False, False]]
    assert grid.occupied().tolist() == [[False, False, False], [False, False, True]]
    assert grid.occupied(50).tolist() == [[False, False, False], [True, True, True]]
    assert grid.as_amcl_sees_it().occupancy.tolist() == [[-1, 0, -1], [-1, -1, 100]]
    assert grid.amcl_states().tolist() == [[0, -1, 0], [0, 0, 1]]
