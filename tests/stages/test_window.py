"""Windows, origins and regions by hand and against the cells' places in the map frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn import cells, grid_from_text
from mapdeal import (
    Costmap,
    FindingError,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    active_region,
    blank,
    esdf,
    exponential_cost,
    reset_region,
    ring_cost,
    shift_origin,
    window,
)
from mapdeal.grid.frame import Frame

NUMBERED = OccupancyGrid(np.arange(12, dtype=np.int8).reshape(3, 4), 0.5, (1.0, 2.0, 0.0))
TURNED = OccupancyGrid(NUMBERED.occupancy, 0.5, (1.0, 2.0, 0.7))


def values_by_place(grid):
    """Each cell's centre, rounded, and its value."""
    rowcol = np.argwhere(np.ones(grid.shape, dtype=bool))
    places = np.round(grid.frame.xy_from_rowcol(rowcol), 6) + 0.0
    return dict(zip(map(tuple, places.tolist()), grid.values.ravel().tolist(), strict=True))


def test_costmap_2d_s_window_of_a_part():
    # costmap_2d/test/static_tests.cpp: cell (i, j) of the window is (i + 2, j + 2) of the map.
    source = OccupancyGrid(np.arange(100, dtype=np.int8).reshape(10, 10), 1.0)
    part = window(source, corner_xy=(2.0, 2.0), size_xy=(6.0, 6.0))
    assert np.array_equal(part.occupancy, source.occupancy[2:8, 2:8])
    assert part.origin == (2.0, 2.0, 0.0)


def test_the_whole_map_and_windows_along_its_upper_edges():
    whole = window(NUMBERED, corner_xy=(1.0, 2.0), size_xy=(2.0, 1.5))
    assert np.array_equal(whole.occupancy, NUMBERED.occupancy)
    assert whole.origin == NUMBERED.origin
    part = window(NUMBERED, corner_xy=(2.0, 2.5), size_xy=(1.0, 1.0))
    assert part.occupancy.tolist() == [[6, 7], [10, 11]]


def test_what_lies_outside_is_unknown():
    part = window(NUMBERED, corner_xy=(0.5, 1.5), size_xy=(1.5, 1.0))
    assert part.occupancy.tolist() == [[-1, -1, -1], [-1, 0, 1]]
    assert part.origin == (0.5, 1.5, 0.0)
    costs = Costmap(NUMBERED.occupancy.astype(np.uint8), 0.5, NUMBERED.origin)
    assert window(costs, corner_xy=(2.5, 3.0), size_xy=(1.0, 1.0)).cost.tolist() == [
        [11, 255], [255, 255],
    ]  # fmt: skip


def test_the_window_stays_on_the_lattice_and_begins_where_the_corner_is():
    part = window(NUMBERED, corner_xy=(1.7, 2.9), size_xy=(1.0, 0.5))
    assert part.origin == (1.5, 2.5, 0.0)
    assert part.occupancy.tolist() == [[5, 6]]
    # 0.3 / 0.1 is 2.9999999999999996 and must be three cells.
    fine = OccupancyGrid(np.zeros((9, 9), np.int8), 0.1)
    assert window(fine, corner_xy=(0.3, 0.6), size_xy=(0.3, 0.3)).shape == (3, 3)
    assert window(fine, corner_xy=(0.3, 0.6), size_xy=(0.3, 0.3)).origin == (0.3, 0.6, 0.0)


def test_a_window_around_a_point():
    part = window(NUMBERED, center_xy=(2.0, 2.75), size_xy=(1.0, 0.5))
    assert part.occupancy.tolist() == [[5, 6]]
    odd = window(NUMBERED, center_xy=(1.75, 2.75), size_xy=(1.5, 1.5))
    assert odd.occupancy.tolist() == [[0, 1, 2], [4, 5, 6], [8, 9, 10]]


@given(st.floats(-3, 3), st.floats(-2, 5), st.floats(-2, 5), st.floats(0.1, 4), st.floats(0.1, 4))
def test_every_cell_of_a_window_keeps_its_place_and_value(yaw, x, y, size_x, size_y):
    source = OccupancyGrid(NUMBERED.occupancy, 0.5, (1.0, 2.0, yaw))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warnings.warn", lambda *_a, **_k: None)
        part = window(source, corner_xy=(x, y), size_xy=(size_x, size_y))
    shape = (max(1, math.ceil(size_y / 0.5 - 1e-9)), max(1, math.ceil(size_x / 0.5 - 1e-9)))
    assert part.shape == shape
    assert part.frame.bounded_rowcol_from_xy([[x, y]])[0].tolist() == [[0, 0]]
    centres = part.frame.xy_from_rowcol(np.argwhere(np.ones(shape, dtype=bool)))
    at, inside = source.frame.bounded_rowcol_from_xy(centres)
    expected = np.where(inside, source.occupancy[tuple(np.maximum(at, 0).T)], -1)
    assert part.occupancy.ravel().tolist() == expected.tolist()


def test_a_turned_map_s_window_lies_along_its_axes():
    middle = TURNED.frame.xy_from_rowcol([[1, 2]])[0]
    part = window(TURNED, center_xy=tuple(middle), size_xy=(0.5, 1.5))
    assert part.occupancy.tolist() == [[2], [6], [10]]
    found, known = values_by_place(part), values_by_place(TURNED)
    assert all(known[place] == value for place, value in found.items())


def test_a_window_without_a_common_cell_is_unknown_with_a_warning():
    with pytest.warns(MapdealWarning, match="no cell"):
        part = window(NUMBERED, corner_xy=(50.0, 2.0), size_xy=(1.0, 1.0))
    assert (part.occupancy == -1).all()


def test_a_window_of_a_field_has_no_distance_beyond_it():
    field = esdf(grid_from_text("....\n.#..\n....", 0.5, (1.0, 2.0, 0.0)))
    part = window(field, corner_xy=(1.5, 2.0), size_xy=(1.0, 1.0))
    assert np.array_equal(part.distance, field.distance[:2, 1:3])
    assert np.array_equal(part.occupancy, field.occupancy[:2, 1:3])
    part = window(field, corner_xy=(2.5, 1.5), size_xy=(1.0, 1.0))
    nan, far = np.nan, np.float32(np.hypot(1.0, 0.5))
    np.testing.assert_array_equal(part.distance, [[nan, nan], [far, nan]])
    assert part.occupancy.tolist() == [[-1, -1], [0, -1]]
    # a window of that, which no distance is lost in, and the whole again
    again = window(part, corner_xy=(1.0, 2.0), size_xy=(2.0, 1.5))
    np.testing.assert_array_equal(again.distance[0], [nan, nan, nan, far])
    assert np.isnan(again.distance[1:]).all()
    with pytest.raises(ParameterError, match="no cell of it has a distance"):
        window(part, corner_xy=(3.0, 1.5), size_xy=(0.5, 0.5))
    with pytest.raises(ParameterError, match="no cell of it has a distance"):
        window(field, corner_xy=(30.0, 1.5), size_xy=(0.5, 0.5))
    with pytest.raises(ParameterError, match="takes none"):
        window(field, corner_xy=(2.5, 1.5), size_xy=(1.0, 1.0), default=0)


def test_a_window_on_the_canvas_of_another_grid():
    whole = grid_from_text("?????\n?#..?\n?..#?\n?????", 0.3, (1.5, -2.0, 0.7))
    known = active_region(whole)
    for made in (known, esdf(known), exponential_cost(known), ring_cost(known)):
        back = window(made, frame=whole.frame)
        assert back.frame == whole.frame  # the origin bit for bit
        again = window(back, frame=known.frame)
        np.testing.assert_array_equal(again.layer, made.layer)
        assert again.frame == known.frame


@pytest.mark.parametrize(
    ("resolution", "origin", "told"),
    [
        (0.31, (1.5, -2.0, 0.7), "must have cells of 0.3 m as the grid has, not of 0.31 m"),
        (0.3, (1.5, -2.0, 0.8), "must have the grid's yaw, 0.7 rad, not 0.8 rad"),
        (0.3, (1.6, -2.0, 0.7), "the edges of the cells must coincide: the origins are not whole"),
    ],
)
def test_a_canvas_with_other_cells_is_refused_and_what_differs_is_named(resolution, origin, told):
    whole = grid_from_text("?????\n?#..?\n?..#?\n?????", 0.3, (1.5, -2.0, 0.7))
    with pytest.raises(ParameterError, match=f"frame: .*{told}"):
        window(whole, frame=Frame(4, 5, resolution, origin))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"corner_xy": (1.0, 2.0)},
        {"corner_xy": (1.0, 2.0), "frame": NUMBERED.frame},
        {"size_xy": (1.0, 1.0), "frame": NUMBERED.frame},
    ],
)
def test_a_window_has_a_size_or_a_frame(options):
    with pytest.raises(ParameterError, match="frame"):
        window(NUMBERED, **options)


@pytest.mark.parametrize(
    "options",
    [
        {"corner_xy": (1.0, 2.0), "size_xy": (0.0, 1.0)},
        {"corner_xy": (1.0, 2.0), "size_xy": (1.0, -1.0)},
        {"corner_xy": (1.0, 2.0), "size_xy": (math.nan, 1.0)},
        {"corner_xy": (1.0, 2.0), "size_xy": (1e300, 1.0)},
        {"corner_xy": (1.0, 2.0), "size_xy": (1e11, 1e11)},
        {"corner_xy": (math.inf, 2.0), "size_xy": (1.0, 1.0)},
        {"center_xy": (1e300, 2.0), "size_xy": (1.0, 1.0)},
        {"corner_xy": (1.0,), "size_xy": (1.0, 1.0)},
        {"corner_xy": (1.0, 2.0), "size_xy": 3.0},
        {"corner_xy": ("a", 2.0), "size_xy": (1.0, 1.0)},
        {"size_xy": (1.0, 1.0)},
        {"size_xy": (1.0, 1.0), "corner_xy": (1.0, 2.0), "center_xy": (1.0, 2.0)},
    ],
)
def test_windows_that_cannot_be_are_refused(options):
    with pytest.raises(ParameterError):
        window(NUMBERED, **options)
    if options["size_xy"] != (1e11, 1e11):
        with pytest.raises(ParameterError):
            reset_region(NUMBERED, **options)


def test_a_shift_keeps_what_both_places_share():
    shifted = shift_origin(NUMBERED, (1.6, 1.2))
    assert shifted.origin == (1.5, 1.0, 0.0)
    assert shifted.occupancy.tolist() == [[-1] * 4, [-1] * 4, [1, 2, 3, -1]]
    back = shift_origin(shift_origin(NUMBERED, (1.5, 2.5)), (1.0, 2.0), default=0)
    assert back.occupancy.tolist() == [[0] * 4, [0, 5, 6, 7], [0, 9, 10, 11]]


def test_a_shift_floors_where_costmap_2d_truncates():
    # By a tenth of a cell to the south-west: one cell, not none.
    assert shift_origin(NUMBERED, (0.95, 1.95)).origin == (0.5, 1.5, 0.0)
    # (0.3 - 0) / 0.1 truncates to 2 cells.
    fine = OccupancyGrid([[1, 2, 3, 4]], 0.1)
    assert shift_origin(fine, (0.3, 0.0), default=0).occupancy.tolist() == [[4, 0, 0, 0]]


def test_a_shift_by_whole_cells_at_utm_coordinates():
    far = OccupancyGrid(NUMBERED.occupancy, 0.05, (500000.0, 4649776.5, 0.0))
    shifted = shift_origin(far, (500000.05, 4649776.55))
    assert shifted.origin == (500000.05, 4649776.55, 0.0)
    assert shifted.occupancy.tolist() == [[5, 6, 7, -1], [9, 10, 11, -1], [-1] * 4]


def test_a_window_around_a_point_at_utm_coordinates():
    far = OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, (500000.0, 4649776.5, 0.0))
    for k in range(1, 30):
        middle = (round(500000 + k * 0.05, 2), round(4649776.5 + k * 0.05, 2))
        part = window(far, center_xy=middle, size_xy=(0.1, 0.1))
        assert far.frame.unbounded_rowcol_from_xy([part.origin[:2]]).tolist() == [[k - 1, k - 1]]


def test_a_shift_along_turned_axes():
    corner = TURNED.frame.xy_from_rowcol([[1, 1]])[0]
    shifted = shift_origin(TURNED, tuple(corner))
    assert shifted.occupancy.tolist() == [[5, 6, 7, -1], [9, 10, 11, -1], [-1] * 4]
    known = values_by_place(TURNED)
    kept = {p: v for p, v in values_by_place(shifted).items() if v != -1}
    assert kept == {p: known[p] for p in kept}


def test_a_shift_far_away_keeps_nothing_and_says_so():
    with pytest.warns(MapdealWarning, match="no cell"):
        shifted = shift_origin(NUMBERED, (1e9, 2.0), default=7)
    assert (shifted.occupancy == 7).all()
    with pytest.raises(ParameterError):
        shift_origin(NUMBERED, (math.nan, 2.0))
    with pytest.raises(ParameterError, match="-1 to 100"):
        shift_origin(NUMBERED, (1.0, 2.0), default=101)


def test_the_default_of_costs_is_their_unknown():
    costs = Costmap([[1, 2]], 0.5, (1.0, 2.0, 0.0))
    assert shift_origin(costs, (1.5, 2.0)).cost.tolist() == [[2, 255]]
    published = Costmap([[1, 2]], 0.5, (1.0, 2.0, 0.0), "occupancy")
    assert shift_origin(published, (1.5, 2.0)).cost.tolist() == [[2, -1]]


def test_a_region_is_reset_and_clipped():
    region = {"corner_xy": (1.5, 2.5), "size_xy": (1.0, 0.5)}
    assert reset_region(NUMBERED, value=100, **region).occupancy.tolist() == [
        [0, 1, 2, 3], [4, 100, 100, 7], [8, 9, 10, 11],
    ]  # fmt: skip
    assert reset_region(NUMBERED, **region).occupancy[1].tolist() == [4, -1, -1, 7]
    beyond = {"center_xy": (3.0, 3.5), "size_xy": (1.0, 1.0)}
    with pytest.warns(MapdealWarning, match="clipped"):
        assert reset_region(NUMBERED, value=50, **beyond).occupancy[2].tolist() == [8, 9, 10, 50]
    with pytest.raises(FindingError, match="region"):
        reset_region(NUMBERED, value=50, strict=True, **beyond)
    with pytest.warns(MapdealWarning, match="outside"):
        far = reset_region(NUMBERED, value=50, corner_xy=(9.0, 9.0), size_xy=(1.0, 1.0))
    assert np.array_equal(far.occupancy, NUMBERED.occupancy)


def test_a_region_may_hold_the_whole_map():
    with pytest.warns(MapdealWarning, match="clipped"):
        cleared = reset_region(NUMBERED, value=0, center_xy=(2.0, 2.0), size_xy=(1e6, 1e6))
    assert not cleared.occupancy.any()


def test_blank_keeps_kind_and_geometry():
    costs = Costmap(np.full((2, 3), 9, np.uint8), 0.5, (1.0, 2.0, 0.3))
    empty = blank(costs)
    assert (empty.scale, empty.origin, empty.cost.any()) == ("costmap2d", costs.origin, False)
    assert np.array_equal(blank(grid_from_text("#?\n..")).occupancy, cells("..\n.."))
