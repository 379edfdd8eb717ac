import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import Footprint, MapdealWarning, OccupancyGrid, inflate
from strategies import RESOLUTIONS, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


@given(occupancies(), RESOLUTIONS, st.sampled_from([0.0, 0.04, 0.1, 0.3, 0.55, 3.0, 1e9]),
       st.sampled_from([50, 100]))  # fmt: skip
def test_the_disc_equals_brute_force(occupancy, resolution, radius, threshold):
    reached = oracles.disc_inflation(occupancy >= threshold, radius, resolution)
    grid = OccupancyGrid(occupancy, resolution)
    inflated = inflate(grid, radius=radius, lethal_threshold=threshold)
    assert np.array_equal(inflated.occupancy, np.where(reached, 100, occupancy))


@given(occupancies(), st.integers(0, 6), st.booleans())
def test_the_square_equals_brute_force(occupancy, reach, inflate_unknown):
    reached = oracles.square_inflation(occupancy >= 100, reach)
    expected = np.where(reached & (inflate_unknown | (occupancy != -1)), 100, occupancy)
    options = {"kernel": "square", "inflate_unknown": inflate_unknown}
    inflated = inflate(OccupancyGrid(occupancy, 0.1), radius=reach * 0.1, **options)
    assert np.array_equal(inflated.occupancy, expected)


def test_a_map_without_a_cell_that_is_left_is_warned_of():
    wide = OccupancyGrid(np.pad([[100]], ((0, 6), (0, 6))), 1.0)
    with pytest.warns(MapdealWarning, match="no cell"):
        assert (inflate(wide, radius=8.5).occupancy == 100).all()  # the far corner is at 8.49


def test_a_footprint_inflates_by_its_circumscribed_radius():
    shape = Footprint.polygon([[0.3, 0.4], [0.3, -0.4], [-0.3, -0.4], [-0.3, 0.4]])
    grid = grid_from_text("......\n......\n..#...")
    by_shape, by_radius = inflate(grid, footprint=shape), inflate(grid, radius=0.5)
    assert np.array_equal(by_shape.occupancy, by_radius.occupancy)
    assert not np.array_equal(by_shape.occupancy, inflate(grid).occupancy)


@pytest.mark.parametrize(("radius", "is_warned"), [(0.0, False), (0.24, True), (0.25, False)])
def test_only_a_disc_below_a_cell_is_warned_of(recwarn, radius, is_warned):
    inflate(grid_from_text("...#", resolution=0.25), radius=radius)
    inflate(grid_from_text("...#", resolution=0.25), radius=radius, kernel="square")
    assert len([w for w in recwarn if "no effect" in str(w.message)]) == is_warned
