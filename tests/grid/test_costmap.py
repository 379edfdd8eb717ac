import numpy as np
import pytest

from mapdeal import Costmap, ParameterError
from mapdeal.grid.costmap import published_costs


def test_costs_are_published_as_ros_publishes_them(real_maps):
    peers = np.load(real_maps / "expected" / "peers.npz")
    assert np.array_equal(published_costs(), peers["to_occ"][0])


def test_a_costmap_becomes_the_occupancy_that_ros_would_publish():
    costmap = Costmap([[0, 1, 128], [253, 254, 255]], 0.2, (1.0, 2.0, 0.5))
    grid = costmap.to_occupancy()
    assert grid.occupancy.tolist() == [[0, 1, 50], [99, 100, -1]]
    assert (grid.resolution, grid.origin) == (0.2, (1.0, 2.0, 0.5))


@pytest.mark.parametrize(("cost", "scale"), [([[-1]], "costmap2d"), ([[101]], "occupancy")])
def test_costs_off_their_scale_are_refused(cost, scale):
    with pytest.raises(ParameterError):
        Costmap(cost, 0.2, scale=scale)
