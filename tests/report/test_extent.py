"""What a page shows at first: the known cells, wherever they lie."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapdeal
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.report.document import Item, page_layers
from mapdeal.report.tiles import extent_of


def layers_of(cells, origin=(2.0, -3.0, 0.0), resolution=0.5):
    return page_layers(mapdeal.OccupancyGrid(cells, resolution, origin), "map", "Map")


@st.composite
def maps(draw):
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    cells = np.full((height, width), -1, np.int8)
    for _ in range(draw(st.integers(1, 4))):
        row, col = draw(st.integers(0, height - 1)), draw(st.integers(0, width - 1))
        cells[row, col] = draw(st.sampled_from([0, 50, 100]))
    return cells


@given(maps(), st.sampled_from([0.0, 0.3, -2.0]))
def test_it_is_the_box_of_known_cells_and_a_margin(cells, yaw):
    layers = layers_of(cells, origin=(2.0, -3.0, yaw))
    rows, cols = np.nonzero(cells >= 0)
    box = [(c * 0.5, r * 0.5) for r in (rows.min(), rows.max() + 1)
           for c in (cols.min(), cols.max() + 1)]  # fmt: skip
    turned = [(2 + a * np.cos(yaw) - b * np.sin(yaw), -3 + a * np.sin(yaw) + b * np.cos(yaw))
              for a, b in box]  # fmt: skip
    low, high = np.min(turned, axis=0), np.max(turned, axis=0)
    margin = 0.04 * max(high - low)
    left, bottom, right, top = extent_of(layers, [])
    assert (left, bottom) == pytest.approx(tuple(low - margin))
    assert (right, top) == pytest.approx(tuple(high + margin))


def test_items_lie_within():
    cells = np.full((6, 8), -1, np.int8)
    cells[2, 3] = 0
    items = [
        Item("goal", "far", place=(40.0, 1.0)),
        Item("route", "way", lines=(np.array([[-5.0, 0.0], [0.0, 30.0]]),)),
        Item("finding", "nowhere"),
    ]
    left, bottom, right, top = extent_of(layers_of(cells), items)
    assert left < -5 < 40 < right
    assert bottom < -2 < 30 < top


def test_nothing_known_is_no_extent():
    assert extent_of(layers_of(np.full((3, 4), -1, np.int8)), []) is None
    field = mapdeal.esdf(mapdeal.OccupancyGrid([[100, 0, 0]], 0.5))
    assert extent_of([page_layers(field, "esdf", "Field")[-1]], []) is None


def test_rows_that_are_made_when_asked_for_give_the_same():
    cells = np.full((50, 8), -1, np.int8)
    cells[17:39, 2:5] = 0
    lazy = lazy_layer(cells.shape, np.int8, lambda rows: cells[rows], block_height=7)
    assert extent_of(layers_of(lazy), []) == extent_of(layers_of(cells), [])
