"""Which part of a map pictures show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapdeal
from mapdeal.grid.frame import Region
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.layers import occupancy_image
from mapdeal.pictures.overlay import PoseOverlay, known_box, shown_part

ORIGIN = (2.0, -3.0, 0.4)


BOX = Region(40, 70, 20, 30)


def canvas(height=120, width=160, box=BOX):
    """A map of which a box is known, its corners at least."""
    cells = np.full((height, width), -1, np.int8)
    row, col, rows, cols = box
    cells[row : row + rows, col : col + cols] = np.random.default_rng(1).choice(
        np.array([-1, 0, 100], np.int8), (rows, cols)
    )
    cells[row, col] = cells[row + rows - 1, col + cols - 1] = 0
    return mapdeal.OccupancyGrid(cells, 0.25, ORIGIN)


@given(
    st.integers(1, 9), st.integers(1, 9),
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), max_size=4), st.booleans(),
)  # fmt: skip
def test_the_box_of_known_cells(height, width, places, is_lazy):
    cells = np.full((height, width), -1, np.int8)
    for row, col in places:
        cells[row % height, col % width] = 50
    known = [(row, col) for row in range(height) for col in range(width) if cells[row, col] >= 0]
    layer = cells
    if is_lazy:
        layer = lazy_layer(cells.shape, np.int8, lambda rows: cells[rows], block_height=2)
    found = known_box(layer, lambda values: values != -1)
    if not known:
        assert found is None
        return
    rows, cols = zip(*known, strict=True)
    assert found == (min(rows), min(cols), max(rows) - min(rows) + 1, max(cols) - min(cols) + 1)


@pytest.mark.parametrize(
    ("size", "box", "shown"),
    [
        ((120, 160), BOX, (30, 60, 40, 50)),  # a margin of ten cells
        ((1000, 900), Region(300, 200, 400, 300), (280, 180, 440, 340)),  # or of a twentieth
        ((120, 160), Region(3, 150, 20, 10), (0, 140, 33, 20)),  # as far as the map goes
        ((120, 160), Region(0, 0, 120, 160), None),  # all of it, or nearly
        ((120, 160), Region(8, 8, 105, 144), None),
    ],
)
def test_the_known_cells_are_shown_with_a_margin(size, box, shown):
    grid = canvas(*size, box)
    assert shown_part(grid.occupancy, grid.frame, "known") == shown
    assert shown_part(grid.occupancy, grid.frame, "all") is None
    assert shown_part(np.full(size, -1, np.int8), grid.frame, "known") is None


def test_what_is_drawn_over_the_map_lies_in_the_picture():
    grid = canvas()
    x, y = grid.frame.xy_from_rowcol([(100, 20)])[0].tolist()
    pose = PoseOverlay((x, y, 0.3))
    # from the robot's cell to the far end of the known box, and ten cells
    assert shown_part(grid.occupancy, grid.frame, "known", overlay=pose) == (30, 10, 81, 100)
    outside = shown_part(grid.occupancy, grid.frame, "known", places_xy=[(900.0, 900.0)])
    assert outside == (30, 60, 90, 100)  # up to the corner of the map that is nearest to it
    assert shown_part(grid.occupancy, grid.frame, "known", places_xy=[(np.nan, 0)]) == (
        30, 60, 40, 50
    )  # fmt: skip


def test_lazy_maps_have_the_same_picture():
    grid = canvas()
    lazy = grid.with_values(
        lazy_layer(grid.shape, np.int8, lambda rows: grid.occupancy[rows], block_height=7)
    )
    pictures = [occupancy_image(one, title="a", image_extent="known") for one in (grid, lazy)]
    assert np.array_equal(pictures[0].indices, pictures[1].indices)
