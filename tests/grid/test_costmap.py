import pytest

from mapdeal import Costmap, ParameterError


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
