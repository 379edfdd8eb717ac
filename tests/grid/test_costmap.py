import pytest

from mapdeal import Costmap, OccupancyGrid, ParameterError


def test_a_costmap_becomes_the_occupancy_that_ros_would_publish():
    costmap = Costmap([[0, 1, 128], [253, 254, 255]], 0.2, (1.0, 2.0, 0.5))
    grid = costmap.to_occupancy()
    assert grid.occupancy.tolist() == [[0, 1, 50], [99, 100, -1]]
    assert (grid.resolution, grid.origin) == (0.2, (1.0, 2.0, 0.5))


@pytest.mark.parametrize(("cost", "scale"), [([[-1]], "costmap2d"), ([[101]], "occupancy")])
def test_costs_off_their_scale_are_refused(cost, scale):
    with pytest.raises(ParameterError):
        Costmap(cost, 0.2, scale=scale)


def test_a_value_must_lie_on_the_grid_s_own_scale():
    stored, published = Costmap([[0]], 0.2), Costmap([[0]], 0.2, scale="occupancy")
    assert (stored.accept_value(255), published.accept_value(-1)) == (255, -1)
    for grid, value in [(stored, -1), (stored, 256), (published, 101), (stored, 2.5),
                        (stored, float("nan"))]:  # fmt: skip
        with pytest.raises(ParameterError, match="whole number"):
            grid.accept_value(value)
    assert (stored.unknown_value, published.unknown_value) == (255, -1)


@pytest.mark.parametrize("cost", [[[-2, 0]], [[0, 101]], [[-128, 100]]])
def test_the_occupancy_scale_ends_at_minus_1_and_100(cost):
    assert Costmap([[-1, 100]], 0.2, scale="occupancy").cost.tolist() == [[-1, 100]]
    with pytest.raises(ParameterError, match=r"must lie in -1..100"):
        Costmap(cost, 0.2, scale="occupancy")


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


def test_unknown_cells_are_free_to_a_static_layer_that_does_not_track_them():
    grid = OccupancyGrid([[0, 50, 99, 100, -1]], 0.05)
    costs = Costmap.from_static_layer(grid, track_unknown=False).cost
    assert costs.tolist() == [[0, 0, 253, 254, 0]]
    costs = Costmap.from_static_layer(grid, lethal_threshold=50, inscribed_value=50).cost
    assert costs.tolist() == [[0, 253, 254, 254, 255]]
    costs = Costmap.from_static_layer(grid, lethal_threshold=0, inscribed_value=None).cost
    assert costs.tolist() == [[254, 254, 254, 254, 255]]


def test_entries_hold_the_circumscribed_cost_if_there_is_one():
    costmap = Costmap([[0, 254]], 0.5, circumscribed_cost=61)
    entries = costmap.entries()
    assert (entries["circumscribed_cost"], entries["cost_scale"]) == (61, "costmap2d")
    assert entries["cost"].tolist() == [[0, 254]]
    assert set(Costmap([[0, 254]], 0.5).entries()) == {"cost", "cost_scale"}
