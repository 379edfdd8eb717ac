"""Lengths in cells, and what lengths and coordinates may be."""

import pytest

from mapdeal import OccupancyGrid, ParameterError
from mapdeal.grid.frame import cells_to_cover, check_point


@pytest.mark.parametrize(
    ("length", "resolution", "cells"),
    [
        (0.07, 0.01, 7),
        (0.14, 0.02, 7),
        (0.0701, 0.01, 8),
        (0.3, 0.1, 3),
        (1e-12, 0.1, 0),
        (0, 1, 0),
    ],
)
def test_a_multiple_that_a_division_makes_longer_takes_no_cell_more(length, resolution, cells):
    assert cells_to_cover(length, resolution) == cells


def test_the_smallest_and_the_largest_cell_and_coordinate_are_allowed():
    for resolution in (1e-6, 1e6):
        assert OccupancyGrid([[0]], resolution).resolution == resolution
    for resolution in (0.99e-6, 1.01e6, -1.0, 0.0):
        with pytest.raises(ParameterError, match="resolution must lie between"):
            OccupancyGrid([[0]], resolution)
    assert OccupancyGrid([[0]], 1.0, (1e12, -1e12, 0)).origin == (1e12, -1e12, 0.0)
    assert check_point((1e12, -1e12), "goal") == (1e12, -1e12)
    for place in [(1.01e12, 0), (0, -1.01e12)]:
        with pytest.raises(ParameterError, match="goal"):
            check_point(place, "goal")
        with pytest.raises(ParameterError, match="origin must be"):
            OccupancyGrid([[0]], 1.0, (*place, 0))
