"""What holds for every stage."""

import numpy as np
import pytest

import mapdeal
from drawn import cells
from mapdeal import MalformedInputError, OccupancyGrid, ParameterError

STAGES = {
    "active": mapdeal.active_region,
    "inflate": mapdeal.inflate,
    "esdf": mapdeal.esdf,
    "exponential": mapdeal.exponential_cost,
    "threshold": mapdeal.threshold_cost,
    "rings": mapdeal.ring_cost,
    "potential": mapdeal.potential,
}
MAPS = {
    "one free cell": ".",
    "one occupied cell": "#",
    "a row": "..#.?.+",
    "a column": ".\n#\n?\n.",
    "all free": "....\n....\n....",
    "all occupied": "####\n####",
    "all unknown": "???\n???",
    "obstacle in the last corner": "...#\n....",
}

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def _layers(grid):
    names = [n for n in ("occupancy", "distance", "cost", "repulsive") if hasattr(grid, n)]
    return {name: getattr(grid, name) for name in names}


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
@pytest.mark.parametrize("drawing", MAPS.values(), ids=MAPS)
def test_input_is_untouched_output_frozen_and_the_same_again(stage, drawing):
    occupancy = cells(drawing)
    before = occupancy.copy()
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    if stage is mapdeal.active_region and (occupancy == -1).all():
        with pytest.raises(MalformedInputError):
            stage(grid)
        return
    first, second = stage(grid), stage(grid)
    assert np.array_equal(occupancy, before)
    assert first.resolution == 0.25
    for name, layer in _layers(first).items():
        assert not layer.flags.writeable
        assert np.array_equal(layer, getattr(second, name))
    if stage is not mapdeal.active_region:
        assert (first.shape, first.origin) == (grid.shape, grid.origin)


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
def test_mirroring_the_map_mirrors_the_result(stage):
    occupancy = cells("..#...\n.?..+.\n....#.\n......")
    for turn in (np.flipud, np.fliplr):
        straight = stage(OccupancyGrid(occupancy, 0.25))
        mirrored = stage(OccupancyGrid(turn(occupancy), 0.25))
        for name, layer in _layers(straight).items():
            expected = turn(layer)
            if name == "repulsive":  # sums whose order is another
                assert np.allclose(expected, getattr(mirrored, name), rtol=1e-12)
            else:
                assert np.array_equal(expected, getattr(mirrored, name))


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
def test_a_bare_array_is_refused_with_what_to_pass(stage):
    with pytest.raises(ParameterError, match="OccupancyGrid"):
        stage(np.zeros((2, 3), np.int8))
