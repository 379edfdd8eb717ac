"""A value has one colour: that of its cell in a picture, and what a page's style gives it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import Costmap, OccupancyGrid, esdf
from mapdeal.grid.values import UNKNOWN
from mapdeal.pictures.canvas import sheet
from mapdeal.pictures.layers import cost_image, field_image, occupancy_image
from mapdeal.report.document import page_layers

ORIGIN = (1.5, -2.0, 0.4)


def pictured(draw, grid):
    """Return the colours in the middles of the cells of a picture, row 0 in the south."""
    recorded = {}

    def record(pixels, palette, **options):
        recorded.update(pixels=pixels, palette=palette)
        return sheet(pixels, palette, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.pictures.canvas.sheet", record)
        draw(grid, title="t")
    pixels = np.asarray(recorded["pixels"])
    step = pixels.shape[0] // grid.shape[0]
    assert step >= 3  # otherwise outlines cover cells
    middles = pixels[step // 2 :: step, step // 2 :: step][: grid.shape[0], : grid.shape[1]]
    return recorded["palette"][middles]


def shown(layers):
    layer = layers[-1]
    style, values = layer.style, np.asarray(layer.values[:])
    states = next(
        (
            np.asarray(other_layer.values[:])
            for other_layer in layers
            if other_layer.name == layer.states
        ),
        None,
    )
    colours = np.empty((*values.shape, 3), dtype=np.uint8)
    for cell, value in np.ndenumerate(values):
        if style.by_value is not None:
            index = int(style.by_value[value])
        elif np.isnan(value):
            index = style.nowhere
        else:
            scale = style.scale
            share = (float(value) - scale.low) / (scale.high - scale.low)
            index = scale.first
            if share == np.inf or share >= 1:
                index += scale.levels - 1
            elif share > 0:
                index += int(share * scale.levels)
            if style.faded_by is not None and states[cell] == 255:
                index += style.faded_by
        colours[cell] = style.colours[index]
    return colours


@pytest.mark.parametrize(
    ("convention", "shape"), [("fast-planner", (3, 5)), ("center", (9, 4)), ("border", (7, 12))]
)
def test_maps_and_fields_have_the_colours_of_their_pictures(convention, shape):
    random = np.random.default_rng(shape[0])
    occupancy = random.choice(np.array([0, 0, 0, 100, -1, 37], dtype=np.int8), shape)
    occupancy[0, 0] = occupancy[-1, -1] = 0  # the extent of a picture is that of known cells
    grid = OccupancyGrid(occupancy, 0.25, ORIGIN)
    assert np.array_equal(shown(page_layers(grid, "m", "M")), pictured(occupancy_image, grid))
    field = esdf(grid, convention=convention)
    off = np.abs(shown(page_layers(field, "f", "F")).astype(int) - pictured(field_image, field))
    open_cells = (occupancy < 100) & (field.distance > 0)  # others have outlines
    assert (occupancy[open_cells] == UNKNOWN).any()
    assert off[open_cells].max() <= 6  # a value between two steps has either colour
    assert (off[open_cells] > 0).mean() < 0.2


@settings(max_examples=8)
@given(st.lists(st.integers(0, 255), min_size=24, max_size=24), st.booleans())
def test_costs_have_the_colours_of_their_pictures(values, is_published):
    cost = np.array(values, dtype=np.uint8).reshape(4, 6)
    costs = Costmap(cost, 0.25, ORIGIN, circumscribed_cost=128)
    if is_published:
        costs = Costmap((cost % 102).astype(np.int8) - 1, 0.25, ORIGIN, "occupancy")
    assert np.array_equal(shown(page_layers(costs, "c", "C")), pictured(cost_image, costs))
