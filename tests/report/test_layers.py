"""Which layers grids become."""

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.pipeline.products import _FILES
from mapdeal.report.layers import kinds_of, page_layers

ROOMS = """
    ?..##...
    ..+##...
    ........
    ...##..?
    ...##..?
"""
GRID = grid_from_text(ROOMS)
GRIDS = {
    mapdeal.OccupancyGrid: GRID,
    mapdeal.FieldView: mapdeal.field_view(mapdeal.esdf(GRID)),
    mapdeal.Costmap: mapdeal.exponential_cost(GRID, inflation_radius=0.6),
    mapdeal.DistanceField: mapdeal.esdf(GRID),
    mapdeal.PotentialField: mapdeal.potential(GRID),
    mapdeal.Reach: mapdeal.reach(GRID, radius=0.1),
}


@pytest.mark.parametrize("made", _FILES, ids=lambda made: made.__name__)
def test_every_type_of_grid_that_is_written_becomes_layers(made):
    grid = GRIDS[made]
    assert type(grid) is made
    layers = page_layers(grid, "name", "Title")
    assert layers[-1].name == "name"  # its own is on top
    for layer in layers:
        assert layer.frame == grid.frame
        assert layer.values.dtype == (np.uint8 if layer.style.by_value is not None else np.float32)
        assert (layer.style.scale is None) == layer.is_bytes
        assert layer.states in (None, *(one.name for one in layers))


def test_an_unknown_type_is_an_error():
    with pytest.raises(TypeError, match="it is not known how a page shows a BitMap"):
        kinds_of(mapdeal.BitMap.from_occupancy(GRID))


def test_unknown_cells_give_way_where_cells_share_a_pixel():
    for made in (mapdeal.OccupancyGrid, mapdeal.Costmap):
        rank = page_layers(GRIDS[made], "name", "Title")[-1].rank
        assert rank[255] == 0
        assert (np.diff(rank[:255].astype(int)) == 1).all()


def test_a_scale_is_shown_where_it_is_needed():
    (with_values,) = page_layers(GRID, "name", "Title")
    (black_and_white,) = page_layers(
        mapdeal.inflate(GRID, radius=0.0, lethal_threshold=50), "n", "T"
    )
    assert with_values.style.bar is not None
    assert black_and_white.style.bar is None


def test_the_legend_is_of_cells_and_not_of_what_pictures_draw_over_them():
    costmap = mapdeal.exponential_cost(GRID, inscribed_radius=0.3, circumscribed_radius=0.5)
    (costs,) = page_layers(costmap, "name", "Title")
    names = [swatch.label.split()[0] for swatch in costs.style.swatches]
    assert names == ["lethal", "inscribed", "free", "unknown"]  # no contour
    *_, potential = page_layers(mapdeal.potential(GRID, goal=(2.0, -1.0)), "name", "Title")
    names = [swatch.label.split(":")[0] for swatch in potential.style.swatches]
    assert names == ["obstacle", "unknown"]  # neither arrows nor the goal
