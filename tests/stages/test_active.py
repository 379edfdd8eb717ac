import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import mapdeal
from drawn import cells, grid_from_text
from mapdeal import MalformedInputError, OccupancyGrid, active_region
from strategies import occupancies

STRAY = """
    ?????????
    ???.#..??
    ???....??
    ?????????
    #????????
"""


def test_stray_cells_are_left_out_and_those_kept_stay_in_place():
    grid = grid_from_text(STRAY, 0.25, (1.5, -2.0, 0.4))
    region = active_region(grid, min_component=2)
    assert region.shape == (2, 4)
    # the obstacle is row 3, column 4 of the map and row 1, column 1 of the region
    assert np.allclose(region.frame.xy_from_rowcol([[1, 1]]), grid.frame.xy_from_rowcol([[3, 4]]))
    assert region.origin[2] == 0.4
    # 0.3 m are two cells; the map ends two columns east and one row north
    assert active_region(grid, min_component=2, margin=0.3).shape == (5, 8)
    full = active_region(grid, min_component=2, canvas="full")
    assert np.array_equal(full.occupancy, cells(STRAY.replace("#????????", "?????????")))
    assert full.frame == grid.frame
    # groups hang together over corners
    assert active_region(grid_from_text(".??\n?.?\n???"), min_component=2).shape == (2, 2)


@given(occupancies(), st.integers(0, 4))
def test_the_box_equals_a_search_cell_by_cell(occupancy, margin):
    known = np.argwhere(occupancy != -1)
    assume(len(known))
    row, col = np.maximum(known.min(axis=0) - margin, 0).tolist()
    last_row, last_col = (known.max(axis=0) + margin).tolist()
    region = active_region(OccupancyGrid(occupancy, 0.1, (0.5, 0.25, 0.0)), margin=margin * 0.1)
    assert np.array_equal(region.occupancy, occupancy[row : last_row + 1, col : last_col + 1])
    assert region.origin == pytest.approx((0.5 + 0.1 * col, 0.25 + 0.1 * row, 0.0))


def test_a_map_without_active_cells_is_an_error():
    with pytest.raises(MalformedInputError, match="no active cells"):
        active_region(grid_from_text("???\n???"))
    with pytest.raises(MalformedInputError, match="no group of 5 known cells or more"):
        active_region(grid_from_text("?..\n???"), min_component=5)


def test_the_playpen_of_the_husky(real_maps, mapdeal_warnings):
    grid = mapdeal.read_map(real_maps / "husky__husky/husky_navigation/maps/playpen_map.yaml")
    region = active_region(grid)
    assert region.shape == (407, 417)
    # 789 columns from the west; 780 rows from the north of 1984, so 797 from the south.
    assert region.origin == pytest.approx((-50 + 789 * 0.05, -50 + 797 * 0.05, 0.0))


VALUES = np.arange(12, dtype=np.int8).reshape(3, 4)
NUMBERED = OccupancyGrid(VALUES, 0.5, (1.0, 2.0, 0.0))
COORDINATES, SIZES = st.floats(-2, 5), st.just(1e-10) | st.floats(0.1, 4)
KINDS = [
    (OccupancyGrid(VALUES, 0.5), -1),
    (mapdeal.Costmap(VALUES.astype(np.uint8), 0.5), 255),
    (mapdeal.Costmap(VALUES, 0.5, scale="occupancy"), -1),
]
"""Grids, each with its value of unknown cells."""


@pytest.mark.usefixtures("mapdeal_warnings")
@given(st.floats(-3, 3), COORDINATES, COORDINATES, SIZES, SIZES, st.sampled_from(KINDS))
def test_every_cell_of_a_window_keeps_its_place_and_value(yaw, x, y, size_x, size_y, kind):
    source, unknown = replace(kind[0], origin=(1.0, 2.0, yaw)), kind[1]

    def expected_on(frame, default):
        centres = frame.xy_from_rowcol(np.argwhere(np.ones(frame.shape, dtype=bool)))
        at, inside = source.frame.bounded_rowcol_from_xy(centres)
        values = np.where(inside, source.layer[tuple(np.maximum(at, 0).T)], default)
        return values.reshape(frame.shape)

    size = (size_x, size_y)
    part = mapdeal.window(source, corner_xy=(x, y), size_xy=size)
    assert part.shape == tuple(max(1, math.ceil(size / 0.5 - 1e-9)) for size in (size_y, size_x))
    assert part.frame.bounded_rowcol_from_xy([[x, y]])[0].tolist() == [[0, 0]]
    assert np.array_equal(part.layer, expected_on(part.frame, unknown))
    # a shift is the window that is as large as the map
    shifted = mapdeal.shift_origin(source, (x, y), default=7)
    assert (shifted.shape, shifted.origin) == (source.shape, part.origin)
    assert np.array_equal(shifted.layer, expected_on(shifted.frame, 7))
    unset = mapdeal.shift_origin(source, (x, y)).layer
    assert np.array_equal(unset, expected_on(shifted.frame, unknown))
    # of the middle of a cell the window around it has that cell in its middle
    middle = tuple(shifted.frame.xy_from_rowcol([[1, 1]])[0])
    around = mapdeal.window(source, center_xy=middle, size_xy=(1.5, 1.5))
    assert np.array_equal(around.layer, expected_on(shifted.frame, unknown)[:, :3])
    # the reset is of the cells that the window shows
    inside = part.frame.contains(source.frame.xy_from_rowcol(np.argwhere(source.layer >= 0)))
    reset = mapdeal.reset_region(source, corner_xy=(x, y), size_xy=size, value=50).layer
    assert np.array_equal(reset.ravel(), np.where(inside, 50, source.layer.ravel()))


def test_a_window_of_a_field_has_no_distance_beyond_it():
    field = mapdeal.esdf(grid_from_text("....\n.#..\n....", 0.5, (1.0, 2.0, 0.0)))
    part = mapdeal.window(field, corner_xy=(1.5, 2.0), size_xy=(1.0, 1.0))
    assert np.array_equal(part.distance, field.distance[:2, 1:3])
    assert np.array_equal(part.occupancy, field.occupancy[:2, 1:3])
    part = mapdeal.window(field, corner_xy=(2.5, 1.5), size_xy=(1.0, 1.0))
    nan, far = np.nan, np.float32(np.hypot(1.0, 0.5))
    np.testing.assert_array_equal(part.distance, [[nan, nan], [far, nan]])
    assert part.occupancy.tolist() == [[-1, -1], [0, -1]]
    # a window of that, which no distance is lost in, and the whole again
    again = mapdeal.window(part, corner_xy=(1.0, 2.0), size_xy=(2.0, 1.5))
    np.testing.assert_array_equal(again.distance[0], [nan, nan, nan, far])
    assert np.isnan(again.distance[1:]).all()


def test_windows_and_shifts_begin_with_the_cell_that_holds_the_corner():
    # 0.3 / 0.1 is 2.9999999999999996 and must be three cells; costmap_2d truncates to 2
    fine = OccupancyGrid(np.zeros((9, 9), np.int8), 0.1)
    part = mapdeal.window(fine, corner_xy=(0.3, 0.6), size_xy=(0.3, 0.3))
    assert (part.shape, part.origin) == ((3, 3), (0.3, 0.6, 0.0))
    row = OccupancyGrid([[1, 2, 3, 4]], 0.1)
    assert mapdeal.shift_origin(row, (0.3, 0.0), default=0).occupancy.tolist() == [[4, 0, 0, 0]]
    # by a tenth of a cell to the south-west: one cell, where costmap_2d truncates to none
    assert mapdeal.shift_origin(NUMBERED, (0.95, 1.95)).origin == (0.5, 1.5, 0.0)


def test_places_without_a_common_cell_are_warned_of():
    with pytest.warns(mapdeal.MapdealWarning, match="no cell"):
        mapdeal.window(NUMBERED, corner_xy=(50.0, 2.0), size_xy=(1.0, 1.0))
    with pytest.warns(mapdeal.MapdealWarning, match="no cell"):
        assert (mapdeal.shift_origin(NUMBERED, (1e9, 2.0), default=7).occupancy == 7).all()
    with pytest.warns(mapdeal.MapdealWarning, match="outside"):
        mapdeal.reset_region(NUMBERED, value=50, corner_xy=(9.0, 9.0), size_xy=(1.0, 1.0))
    beyond = {"center_xy": (3.0, 3.5), "size_xy": (1.0, 1.0)}
    with pytest.warns(mapdeal.MapdealWarning, match="clipped"):
        reset = mapdeal.reset_region(NUMBERED, **beyond)
    assert reset.occupancy[2].tolist() == [8, 9, 10, -1]
    with pytest.raises(mapdeal.FindingError, match="region"):
        mapdeal.reset_region(NUMBERED, value=50, strict=True, **beyond)


def test_a_window_on_the_canvas_of_another_grid():
    source = grid_from_text("?????\n?#..?\n?..#?\n?????", 0.3, (1.5, -2.0, 0.7))
    known = active_region(source)
    costs = mapdeal.exponential_cost(known), mapdeal.ring_cost(known)
    for product in (known, mapdeal.esdf(known), *costs):
        frames = [{"corner_xy": grid.origin[:2], "size_xy": grid.frame.size_xy}
                  for grid in (source, known)]  # fmt: skip
        back = mapdeal.window(product, **frames[0])
        assert back.frame == source.frame  # the origin bit for bit
        again = mapdeal.window(back, **frames[1])
        np.testing.assert_array_equal(again.layer, product.layer)
        assert again.frame == known.frame


def test_a_window_around_a_point_at_utm_coordinates():
    far = mapdeal.OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, (500000.0, 4649776.5, 0.0))
    for k in range(1, 30):
        middle = (round(500000 + k * 0.05, 2), round(4649776.5 + k * 0.05, 2))
        part = mapdeal.window(far, center_xy=middle, size_xy=(0.1, 0.1))
        assert far.frame.unbounded_rowcol_from_xy([part.origin[:2]]).tolist() == [[k - 1, k - 1]]


def test_blank_keeps_kind_and_geometry():
    costs = mapdeal.Costmap(np.full((2, 3), 9, np.uint8), 0.5, (1.0, 2.0, 0.3))
    empty = mapdeal.blank(costs)
    assert (empty.scale, empty.origin, empty.cost.any()) == ("costmap2d", costs.origin, False)
    assert np.array_equal(mapdeal.blank(grid_from_text("#?\n..")).occupancy, cells("..\n.."))
