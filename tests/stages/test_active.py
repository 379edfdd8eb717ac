"""Windows, origins, regions and active parts, by hand and by the places of cells."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

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


def test_cells_keep_their_place_in_the_map_frame_at_any_yaw():
    grid = grid_from_text(STRAY, origin=(1.5, -2.0, 0.4))
    region = active_region(grid, min_component=2)
    assert region.shape == (2, 4)
    # The obstacle is row 3, column 4 of the map and row 1, column 1 of the region.
    assert np.allclose(region.frame.xy_from_rowcol([[1, 1]]), grid.frame.xy_from_rowcol([[3, 4]]))
    assert region.origin[2] == 0.4


def test_groups_hang_together_over_corners():
    grid = grid_from_text(".??\n?.?\n???")
    assert active_region(grid, min_component=2).shape == (2, 2)


def test_the_margin_is_whole_cells_and_clipped_to_the_map():
    grid = grid_from_text(STRAY, resolution=0.25)
    # 0.3 m are two cells of 0.25 m; the map ends two columns east and one row north.
    region = active_region(grid, min_component=2, margin=0.3)
    assert region.shape == (5, 8)


def test_the_full_canvas_keeps_size_and_origin_and_blanks_the_rest():
    grid = grid_from_text(STRAY)
    region = active_region(grid, min_component=2, canvas="full")
    blanked = STRAY.replace("#????????", "?????????")
    assert np.array_equal(region.occupancy, cells(blanked))
    assert region.origin == grid.origin


@given(occupancies(), st.integers(0, 4))
def test_the_box_equals_a_search_cell_by_cell(occupancy, margin_cells):
    known = np.argwhere(occupancy != -1).tolist()
    assume(known)
    rows, cols = [r for r, _ in known], [c for _, c in known]
    height, width = occupancy.shape
    first_row, last_row = (
        max(min(rows) - margin_cells, 0),
        min(max(rows) + margin_cells, height - 1),
    )
    first_col, last_col = max(min(cols) - margin_cells, 0), min(max(cols) + margin_cells, width - 1)
    region = active_region(
        OccupancyGrid(occupancy, 0.1, (0.5, 0.25, 0.0)), margin=margin_cells * 0.1
    )
    assert np.array_equal(
        region.occupancy, occupancy[first_row : last_row + 1, first_col : last_col + 1]
    )
    assert region.origin == pytest.approx((0.5 + 0.1 * first_col, 0.25 + 0.1 * first_row, 0.0))


@pytest.mark.parametrize("least", [0, 5])
def test_a_map_without_active_cells_is_an_error(least):
    drawing = "???\n???" if least == 0 else "?..\n???"
    told = "no group of 5 known cells or more" if least else "no active cells"
    with pytest.raises(MalformedInputError, match=told):
        active_region(grid_from_text(drawing), min_component=least)


def test_the_playpen_of_the_husky(real_maps, mapdeal_warnings):
    from mapdeal import read_map

    grid = read_map(real_maps / "husky__husky/husky_navigation/maps/playpen_map.yaml")
    region = active_region(grid)
    assert region.shape == (407, 417)
    # 789 columns from the west; 780 rows from the north of 1984, so 797 from the south.
    assert region.origin == pytest.approx((-50 + 789 * 0.05, -50 + 797 * 0.05, 0.0))


NUMBERED = mapdeal.OccupancyGrid(np.arange(12, dtype=np.int8).reshape(3, 4), 0.5, (1.0, 2.0, 0.0))
TURNED = mapdeal.OccupancyGrid(NUMBERED.occupancy, 0.5, (1.0, 2.0, 0.7))


def test_costmap_2d_s_window_of_a_part():
    # costmap_2d/test/static_tests.cpp: cell (i, j) of the window is (i + 2, j + 2) of the map.
    source = mapdeal.OccupancyGrid(np.arange(100, dtype=np.int8).reshape(10, 10), 1.0)
    part = mapdeal.window(source, corner_xy=(2.0, 2.0), size_xy=(6.0, 6.0))
    assert np.array_equal(part.occupancy, source.occupancy[2:8, 2:8])
    assert part.origin == (2.0, 2.0, 0.0)


def test_what_lies_outside_is_unknown():
    part = mapdeal.window(NUMBERED, corner_xy=(0.5, 1.5), size_xy=(1.5, 1.0))
    assert part.occupancy.tolist() == [[-1, -1, -1], [-1, 0, 1]]
    assert part.origin == (0.5, 1.5, 0.0)
    costs = mapdeal.Costmap(NUMBERED.occupancy.astype(np.uint8), 0.5, NUMBERED.origin)
    assert mapdeal.window(costs, corner_xy=(2.5, 3.0), size_xy=(1.0, 1.0)).cost.tolist() == [
        [11, 255], [255, 255],
    ]  # fmt: skip


def test_the_window_stays_on_the_lattice_and_begins_where_the_corner_is():
    part = mapdeal.window(NUMBERED, corner_xy=(1.7, 2.9), size_xy=(1.0, 0.5))
    assert part.origin == (1.5, 2.5, 0.0)
    assert part.occupancy.tolist() == [[5, 6]]
    # 0.3 / 0.1 is 2.9999999999999996 and must be three cells.
    fine = mapdeal.OccupancyGrid(np.zeros((9, 9), np.int8), 0.1)
    assert mapdeal.window(fine, corner_xy=(0.3, 0.6), size_xy=(0.3, 0.3)).shape == (3, 3)
    assert mapdeal.window(fine, corner_xy=(0.3, 0.6), size_xy=(0.3, 0.3)).origin == (0.3, 0.6, 0.0)


def test_a_window_around_a_point():
    part = mapdeal.window(NUMBERED, center_xy=(2.0, 2.75), size_xy=(1.0, 0.5))
    assert part.occupancy.tolist() == [[5, 6]]
    odd = mapdeal.window(NUMBERED, center_xy=(1.75, 2.75), size_xy=(1.5, 1.5))
    assert odd.occupancy.tolist() == [[0, 1, 2], [4, 5, 6], [8, 9, 10]]


@given(st.floats(-3, 3), st.floats(-2, 5), st.floats(-2, 5), st.floats(0.1, 4), st.floats(0.1, 4))
def test_every_cell_of_a_window_keeps_its_place_and_value(yaw, x, y, size_x, size_y):
    source = mapdeal.OccupancyGrid(NUMBERED.occupancy, 0.5, (1.0, 2.0, yaw))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warnings.warn", lambda *_a, **_k: None)
        part = mapdeal.window(source, corner_xy=(x, y), size_xy=(size_x, size_y))
    shape = (max(1, math.ceil(size_y / 0.5 - 1e-9)), max(1, math.ceil(size_x / 0.5 - 1e-9)))
    assert part.shape == shape
    assert part.frame.bounded_rowcol_from_xy([[x, y]])[0].tolist() == [[0, 0]]
    centres = part.frame.xy_from_rowcol(np.argwhere(np.ones(shape, dtype=bool)))
    at, inside = source.frame.bounded_rowcol_from_xy(centres)
    expected = np.where(inside, source.occupancy[tuple(np.maximum(at, 0).T)], -1)
    assert part.occupancy.ravel().tolist() == expected.tolist()


def test_a_window_without_a_common_cell_is_unknown_with_a_warning():
    with pytest.warns(mapdeal.MapdealWarning, match="no cell"):
        part = mapdeal.window(NUMBERED, corner_xy=(50.0, 2.0), size_xy=(1.0, 1.0))
    assert (part.occupancy == -1).all()


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


def test_a_window_on_the_canvas_of_another_grid():
    whole = grid_from_text("?????\n?#..?\n?..#?\n?????", 0.3, (1.5, -2.0, 0.7))
    known = mapdeal.active_region(whole)
    for made in (
        known,
        mapdeal.esdf(known),
        mapdeal.exponential_cost(known),
        mapdeal.ring_cost(known),
    ):
        back = mapdeal.window(made, frame=whole.frame)
        assert back.frame == whole.frame  # the origin bit for bit
        again = mapdeal.window(back, frame=known.frame)
        np.testing.assert_array_equal(again.layer, made.layer)
        assert again.frame == known.frame


def test_a_shift_keeps_what_both_places_share():
    shifted = mapdeal.shift_origin(NUMBERED, (1.6, 1.2))
    assert shifted.origin == (1.5, 1.0, 0.0)
    assert shifted.occupancy.tolist() == [[-1] * 4, [-1] * 4, [1, 2, 3, -1]]
    back = mapdeal.shift_origin(mapdeal.shift_origin(NUMBERED, (1.5, 2.5)), (1.0, 2.0), default=0)
    assert back.occupancy.tolist() == [[0] * 4, [0, 5, 6, 7], [0, 9, 10, 11]]


def test_a_shift_floors_where_costmap_2d_truncates():
    # By a tenth of a cell to the south-west: one cell, not none.
    assert mapdeal.shift_origin(NUMBERED, (0.95, 1.95)).origin == (0.5, 1.5, 0.0)
    # (0.3 - 0) / 0.1 truncates to 2 cells.
    fine = mapdeal.OccupancyGrid([[1, 2, 3, 4]], 0.1)
    assert mapdeal.shift_origin(fine, (0.3, 0.0), default=0).occupancy.tolist() == [[4, 0, 0, 0]]


def test_a_window_around_a_point_at_utm_coordinates():
    far = mapdeal.OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, (500000.0, 4649776.5, 0.0))
    for k in range(1, 30):
        middle = (round(500000 + k * 0.05, 2), round(4649776.5 + k * 0.05, 2))
        part = mapdeal.window(far, center_xy=middle, size_xy=(0.1, 0.1))
        assert far.frame.unbounded_rowcol_from_xy([part.origin[:2]]).tolist() == [[k - 1, k - 1]]


def test_a_shift_along_turned_axes():
    corner = TURNED.frame.xy_from_rowcol([[1, 1]])[0]
    shifted = mapdeal.shift_origin(TURNED, tuple(corner))
    assert shifted.occupancy.tolist() == [[5, 6, 7, -1], [9, 10, 11, -1], [-1] * 4]


def test_a_shift_far_away_keeps_nothing_and_says_so():
    with pytest.warns(mapdeal.MapdealWarning, match="no cell"):
        shifted = mapdeal.shift_origin(NUMBERED, (1e9, 2.0), default=7)
    assert (shifted.occupancy == 7).all()


def test_the_default_of_costs_is_their_unknown():
    costs = mapdeal.Costmap([[1, 2]], 0.5, (1.0, 2.0, 0.0))
    assert mapdeal.shift_origin(costs, (1.5, 2.0)).cost.tolist() == [[2, 255]]
    published = mapdeal.Costmap([[1, 2]], 0.5, (1.0, 2.0, 0.0), "occupancy")
    assert mapdeal.shift_origin(published, (1.5, 2.0)).cost.tolist() == [[2, -1]]


def test_a_region_is_reset_and_clipped():
    region = {"corner_xy": (1.5, 2.5), "size_xy": (1.0, 0.5)}
    assert mapdeal.reset_region(NUMBERED, value=100, **region).occupancy.tolist() == [
        [0, 1, 2, 3], [4, 100, 100, 7], [8, 9, 10, 11],
    ]  # fmt: skip
    assert mapdeal.reset_region(NUMBERED, **region).occupancy[1].tolist() == [4, -1, -1, 7]
    beyond = {"center_xy": (3.0, 3.5), "size_xy": (1.0, 1.0)}
    with pytest.warns(mapdeal.MapdealWarning, match="clipped"):
        assert mapdeal.reset_region(NUMBERED, value=50, **beyond).occupancy[2].tolist() == [
            8,
            9,
            10,
            50,
        ]
    with pytest.raises(mapdeal.FindingError, match="region"):
        mapdeal.reset_region(NUMBERED, value=50, strict=True, **beyond)
    with pytest.warns(mapdeal.MapdealWarning, match="outside"):
        far = mapdeal.reset_region(NUMBERED, value=50, corner_xy=(9.0, 9.0), size_xy=(1.0, 1.0))
    assert np.array_equal(far.occupancy, NUMBERED.occupancy)


def test_blank_keeps_kind_and_geometry():
    costs = mapdeal.Costmap(np.full((2, 3), 9, np.uint8), 0.5, (1.0, 2.0, 0.3))
    empty = mapdeal.blank(costs)
    assert (empty.scale, empty.origin, empty.cost.any()) == ("costmap2d", costs.origin, False)
    assert np.array_equal(mapdeal.blank(grid_from_text("#?\n..")).occupancy, cells("..\n.."))
