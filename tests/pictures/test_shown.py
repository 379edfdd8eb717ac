"""Which part of a map pictures show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapdeal
from mapdeal.grid.frame import Region
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.layers import occupancy_image
from mapdeal.pictures.overlay import PoseOverlay, Raster, known_box, shown_part
from mapdeal.pipeline.folder import _FILES

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


def test_the_known_cells_are_shown_with_a_margin_of_ten_cells_or_a_twentieth():
    grid = canvas()
    assert shown_part(grid.occupancy, grid.frame, "known") == (30, 60, 40, 50)
    grid = canvas(1000, 900, Region(300, 200, 400, 300))
    assert shown_part(grid.occupancy, grid.frame, "known") == (280, 180, 440, 340)


def test_the_margin_ends_at_the_map():
    grid = canvas(box=Region(3, 150, 20, 10))
    assert shown_part(grid.occupancy, grid.frame, "known") == (0, 140, 33, 20)


@pytest.mark.parametrize("box", [Region(0, 0, 120, 160), Region(8, 8, 105, 144)])
def test_maps_that_are_known_nearly_all_over_are_shown_as_a_whole(box):
    grid = canvas(box=box)
    assert shown_part(grid.occupancy, grid.frame, "known") is None


def test_all_is_shown_if_asked_for_or_nothing_is_known():
    grid = canvas()
    unknown = np.full((120, 160), -1, np.int8)
    assert shown_part(grid.occupancy, grid.frame, "all") is None
    assert shown_part(unknown, grid.frame, "known") is None


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


def grids_of(grid):
    made = [
        grid,
        mapdeal.field_view(mapdeal.esdf(grid)),
        mapdeal.exponential_cost(grid, inflation_radius=1.0, cost_scaling_factor=2.0),
        mapdeal.esdf(grid),
        mapdeal.potential(grid),
        mapdeal.reach(grid, radius=0.1),
    ]
    return {type(one): one for one in made}


@pytest.mark.parametrize("made", _FILES, ids=lambda made: made.__name__)
@pytest.mark.parametrize("image_max", [2048, 0, 30])
def test_cells_have_the_colours_that_they_have_on_the_whole_map(made, image_max):
    """Each pixel of a cell in the picture of all is one in that of the part, cell by cell."""
    grid = canvas()
    shown = grids_of(grid)[made]
    draw = _FILES[made].draw
    images = {
        extent: draw(shown, title="a", image_max=image_max, image_extent=extent)
        for extent in ("known", "all")
    }
    colours = {extent: image.palette[image.indices] for extent, image in images.items()}
    if image_max != 0:  # the map is drawn larger, or in fewer cells a pixel
        assert colours["known"].shape != colours["all"].shape
        return
    part = Region(30, 60, 40, 50)
    height, width = colours["all"].shape[:2]
    wanted = _map_of(images["all"], (120, 160))[120 - 70 : 120 - 30, 60:110]
    found = _map_of(images["known"], (part.height, part.width))
    assert (height, width) > found.shape[:2]
    same = (wanted == found).all(axis=2)
    if made in (mapdeal.PotentialField, mapdeal.Reach):  # arrows and marks are of a size in pixels
        assert same.mean() > 0.5
    else:
        inner = same[1:-1, 1:-1]  # an outline ends at the border of a picture
        assert inner.all()


def _map_of(image, shape):
    """Return the colours of the map's pixels, one per cell: the box inside of the thin frame."""
    indices = image.indices
    height, width = shape
    grey = indices == _frame_index(image)
    for top in range(indices.shape[0] - height - 1):
        for left in np.flatnonzero(grey[top]):
            edges = (
                grey[top, left : left + width + 2],
                grey[top + height + 1, left : left + width + 2],
                grey[top : top + height + 2, left],
            )
            if left + width + 2 <= indices.shape[1] and all(edge.all() for edge in edges):
                inside = indices[top + 1 : top + 1 + height, left + 1 : left + 1 + width]
                return image.palette[inside].astype(int)
    raise AssertionError("no frame")


def _frame_index(_):
    from mapdeal.pictures.canvas import GREY

    return GREY


def test_pixels_are_of_the_part_alone():
    layer = np.arange(48).reshape(6, 8)
    part = Region(1, 2, 4, 5)
    assert Raster(part=part).largest(layer).tolist() == layer[1:5, 2:7].tolist()
    lazy = lazy_layer(layer.shape, layer.dtype, lambda rows: layer[rows], block_height=2)
    for one in (layer, lazy):
        assert Raster(reduce=2, part=part).largest(one).tolist() == [
            [layer[2, 3], layer[2, 5], layer[2, 6]], [layer[4, 3], layer[4, 5], layer[4, 6]]
        ]  # fmt: skip


def test_lazy_maps_have_the_same_picture():
    grid = canvas()
    lazy = grid.with_values(
        lazy_layer(grid.shape, np.int8, lambda rows: grid.occupancy[rows], block_height=7)
    )
    pictures = [occupancy_image(one, title="a", image_extent="known") for one in (grid, lazy)]
    assert np.array_equal(pictures[0].indices, pictures[1].indices)
