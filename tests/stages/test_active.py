import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

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


def test_the_box_of_known_cells_is_cut_out():
    region = active_region(grid_from_text("????\n?.#?\n?.??\n????\n????"))
    assert np.array_equal(region.occupancy, cells(".#\n.?"))


def test_cells_keep_their_place_in_the_map_frame_at_any_yaw():
    grid = grid_from_text(STRAY, origin=(1.5, -2.0, 0.4))
    region = active_region(grid, min_component=2)
    assert region.shape == (2, 4)
    # The obstacle is row 3, column 4 of the map and row 1, column 1 of the region.
    assert np.allclose(region.frame.xy_from_rowcol([[1, 1]]), grid.frame.xy_from_rowcol([[3, 4]]))
    assert region.origin[2] == 0.4


def test_a_stray_cell_widens_the_box_unless_small_groups_are_left_out():
    grid = grid_from_text(STRAY)
    assert active_region(grid).shape == (4, 7)
    assert active_region(grid, min_component=2).shape == (2, 4)


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
    with pytest.raises(MalformedInputError, match="no active cells"):
        active_region(grid_from_text(drawing), min_component=least)


def test_the_playpen_of_the_husky(real_maps, mapdeal_warnings):
    from mapdeal import read_map

    grid = read_map(real_maps / "husky__husky/husky_navigation/maps/playpen_map.yaml")
    region = active_region(grid)
    assert region.shape == (407, 417)
    # 789 columns from the west; 780 rows from the north of 1984, so 797 from the south.
    assert region.origin == pytest.approx((-50 + 789 * 0.05, -50 + 797 * 0.05, 0.0))


def test_groups_that_are_too_small_are_told_by_their_size():
    with pytest.raises(MalformedInputError, match="no group of 5 known cells or more"):
        active_region(grid_from_text("?..\n???"), min_component=5)


@pytest.mark.parametrize("margin", [5, 6, 7])
def test_a_margin_is_the_same_on_all_sides(margin):
    occupancy = np.full((30, 40), -1, np.int8)
    occupancy[12:14, 15:18] = 0
    region = active_region(OccupancyGrid(occupancy, 0.5), margin=margin * 0.5)
    assert region.shape == (2 + 2 * margin, 3 + 2 * margin)
    assert region.origin == ((15 - margin) * 0.5, (12 - margin) * 0.5, 0.0)
