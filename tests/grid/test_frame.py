import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import BitMap, Costmap, Frame, OccupancyGrid, ParameterError
from mapdeal.grid.frame import Region, Transform, cells_to_cover, check_point, region_around
from strategies import masks

YAWED = Frame(4, 7, 0.25, (1.5, -2.0, math.pi / 2))


def test_costmap_2d_reference_points():
    # costmap_2d/test/static_tests.cpp and coordinates_test.cpp
    unit = Frame(10, 10, 1.0)
    points = [[0, 0.99], [0, 1.0], [1, 0.99], [9.99, 9.99], [8.2, 3.4]]
    rows_cols = unit.unbounded_rowcol_from_xy(points)
    assert [r * 10 + c for r, c in rows_cols.tolist()] == [0, 10, 1, 99, 38]
    small = Frame(3, 2, 0.1, (-0.2, 0.2, 0.0))
    assert np.allclose(small.xy_from_rowcol([[2, 1]]), [[-0.05, 0.45]])
    # x = 2.55 is column 27 without bounds and 1 within; Nav2 has the size itself at upper edges
    assert small.unbounded_rowcol_from_xy([[2.55, 0.3]]).tolist() == [[1, 27]]
    points = [[2.55, 0.3], [0.0, 0.5], [-9.0, -9.0]]
    assert small.clamped_rowcol_from_xy(points).tolist() == [[1, 1], [2, 1], [0, 0]]
    # costmap_2d says (W - 1 + 0.5) times the resolution, half a cell short
    assert Frame(4, 7, 0.25).size_xy == (1.75, 1.0)


@given(st.floats(-4, 4), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.integers(-50, 50),
       st.integers(-50, 50))  # fmt: skip
def test_a_centre_falls_into_its_own_cell(yaw, x, y, row, col):
    frame = Frame(9, 5, 0.05, (x, y, yaw))
    place = frame.xy_from_rowcol([[row, col]])
    is_inside = 0 <= row < 9 and 0 <= col < 5
    assert frame.unbounded_rowcol_from_xy(place).tolist() == [[row, col]]
    cells, inside = frame.bounded_rowcol_from_xy(place)
    assert cells.tolist() == [[row, col] if is_inside else [-1, -1]]
    assert inside[0] == frame.contains(place)[0] == is_inside
    assert frame.clamped_rowcol_from_xy(place).tolist() == [np.clip((row, col), 0, (8, 4)).tolist()]


@pytest.mark.parametrize("resolution", [0.05, 0.0504, 0.025, 0.001])
def test_exact_multiples_are_exact_at_utm_coordinates_too(resolution):
    frame = Frame(5, 7, resolution, (500000.0, 4649776.5, 0.0))
    for k in range(300):
        window = frame.window(k, 2 * k, 5, 7)
        assert frame.unbounded_rowcol_from_xy([window.origin[:2]]).tolist() == [[k, 2 * k]]
    # As a user writes them: the nearest float to the decimal number.
    points = [[round(500000 + k * resolution, 6), 4649776.5] for k in range(300)]
    assert frame.unbounded_rowcol_from_xy(points)[:, 1].tolist() == list(range(300))


def test_the_grid_is_half_open():
    frame = Frame(4, 8, 0.5, (-1.0, 2.0, 0.0))
    corners = [[-1.0, 2.0], [3.0, 2.0], [-1.0, 4.0], [2.999, 3.999], [-1.001, 2.0]]
    assert frame.contains(corners).tolist() == [True, False, False, True, False]
    odd = [[math.nan, 0.0], [math.inf, 0.0], [0.0, -1e300]]
    assert YAWED.bounded_rowcol_from_xy(odd)[1].tolist() == [False] * 3
    unit = Frame(3, 8, 1.0)
    x, y = 8 - 1e-9, 3 - 1e-9  # taken one tolerance farther, they are on the edge
    assert (x + 1e-9, y + 1e-9) == (8.0, 3.0)
    cells, inside = unit.bounded_rowcol_from_xy([[x, 0.5], [0.5, y], [7.99, 2.99]])
    assert (cells.tolist(), inside.tolist()) == ([[-1, -1], [-1, -1], [2, 7]], [False, False, True])


@pytest.mark.parametrize(("height", "width"), [(4, 6), (5, 7), (1, 1)])
def test_the_centred_frame_of_design_document_003(height, width):
    frame = Frame.centred(height, width, 0.1)
    for x, y in [(0.0, 0.0), (0.14, -0.06), (-0.01, 0.01), (-0.3, 0.19)]:
        row, col = frame.unbounded_rowcol_from_xy([[x, y]])[0].tolist()
        assert row == math.floor(y / 0.1 + 1e-9) + height // 2
        assert col == math.floor(x / 0.1 + 1e-9) + width // 2
    turned = Frame.centred(4, 6, 0.5, yaw=math.pi / 2)
    assert np.allclose(turned.continuous_rowcol_from_xy([[0.0, 0.0]]), [[2.0, 3.0]])


@pytest.mark.parametrize(("yaw", "cell"), [
    (0.0, (10, 14)), (math.pi / 2, (14, 10)), (math.pi, (10, 6)), (-math.pi / 2, (6, 10)),
])  # fmt: skip
def test_the_cell_ahead_of_a_robot(yaw, cell):
    frame = Frame.centred(20, 20, 0.1)
    assert frame.rowcol_ahead((0.05, 0.05, yaw), 0.4) == cell
    # a right-handed form: theta is measured from the y axis.
    theta = yaw - math.pi / 2
    point = [0.05 - 0.4 * math.sin(theta), 0.05 + 0.4 * math.cos(theta)]
    assert tuple(frame.unbounded_rowcol_from_xy([point])[0].tolist()) == cell


def test_a_window_keeps_its_cells_in_place_at_any_yaw():
    window = YAWED.window(1, 2, 2, 3)
    assert window.shape == (2, 3)
    expected = YAWED.xy_from_rowcol([[1, 2], [2, 4]])
    assert np.allclose(window.xy_from_rowcol([[0, 0], [1, 2]]), expected)
    # clean decimals, where nothing is turned
    window = Frame(1984, 1984, 0.05, (-50.0, -50.0, 0.0)).window(797, 789, 407, 417)
    assert window.origin == (-10.55, -10.15, 0.0)


def test_a_multiple_that_a_division_makes_longer_takes_no_cell_more():
    for length, resolution, cells in (
        (0.07, 0.01, 7), (0.0701, 0.01, 8), (0.3, 0.1, 3), (0.6, 0.2, 3), (1e-12, 0.1, 0), (0, 1, 0)
    ):  # fmt: skip
        assert cells_to_cover(length, resolution) == cells


def test_numbers_of_numpy_are_taken_as_plain_ones():
    window = Frame(9, 9, np.float64(0.05), np.array([1.0, 2.0, 0.0])).window(1, 1, 2, 2)
    assert (repr(window.resolution), window.origin) == ("0.05", (1.05, 2.05, 0.0))
    grids = (kind(np.array([[False, True]]), 0.05) for kind in (OccupancyGrid, Costmap))
    assert [grid.layer.tolist() for grid in grids] == [[[0, 100]], [[0, 254]]]


def test_the_smallest_and_the_largest_cell_and_coordinate_are_allowed():
    for resolution in (1e-6, 1e6):
        assert OccupancyGrid([[0]], resolution).resolution == resolution
    assert OccupancyGrid([[0]], 1.0, (1e12, -1e12, 0)).origin == (1e12, -1e12, 0.0)
    assert check_point((1e12, -1e12), "goal") == (1e12, -1e12)


def test_a_grid_cannot_be_changed():
    grid = OccupancyGrid([[0, 0]], 0.05)
    with pytest.raises(ValueError, match="read-only"):
        grid.occupancy[0, 0] = 1
    with pytest.raises(AttributeError):
        grid.resolution = 0.1


UPRIGHT = Frame(5, 8, 0.5, (1.0, -2.0, 0.0))


@pytest.mark.parametrize(("contents", "region"), [
    (Frame(2, 3, 0.5, (2.0, -2.5, 0.0)), Region(-1, 2, 2, 3)),
    # borders that differ by rounding are the same, others take one more cell
    (Frame(2, 3, 0.5, (2.0 - 1e-8, -2.5 + 1e-8, 0.0)), Region(-1, 2, 2, 3)),
    (Frame(2, 3, 0.5, (2.1, -2.4, 0.0)), Region(-1, 2, 3, 4)),
    (Frame(2, 3, 0.5, (2.0, -1.0, math.pi / 2)), Region(2, 0, 3, 2)),  # rows go to the left
])  # fmt: skip
def test_the_cells_around_another_grid(contents, region):
    assert region_around(UPRIGHT, contents) == region


def test_a_window_has_at_most_so_many_cells(monkeypatch):
    monkeypatch.setattr("mapdeal.grid.frame.MOST_CELLS", 12)
    assert Region(1, 2, 3, 4).frame_in(UPRIGHT) == Frame(3, 4, 0.5, (2.0, -1.5, 0.0))
    with pytest.raises(ParameterError, match="more than 12 cells"):
        Region(0, 0, 13, 1).frame_in(UPRIGHT)


TRANSFORMS = st.builds(Transform, st.floats(-50, 50), st.floats(-50, 50), st.floats(-6, 6))
PLACES = st.tuples(st.floats(-50, 50), st.floats(-50, 50))


@given(TRANSFORMS, TRANSFORMS, PLACES, st.floats(-6, 6))
def test_points_and_frames_are_turned_and_then_shifted(first, second, place, yaw):
    moved = complex(*place) * complex(math.cos(first.yaw), math.sin(first.yaw))
    moved += complex(first.x, first.y)
    points = first.points([place])
    np.testing.assert_allclose(points, [[moved.real, moved.imag]], atol=1e-9)
    np.testing.assert_allclose(first.inverse().points(points), [place], atol=1e-9)
    both = second.after(first).points([place])
    np.testing.assert_allclose(both, second.points(points), atol=1e-9)
    frame, cells = Frame(3, 5, 0.4, (-2.0, 1.5, yaw)), [[0, 0], [2, 4], [1, 3]]
    turn = complex(0.4 * math.cos(yaw), 0.4 * math.sin(yaw))
    centres = [complex(-2.0, 1.5) + complex(col + 0.5, row + 0.5) * turn for row, col in cells]
    expected = first.points([(centre.real, centre.imag) for centre in centres])
    np.testing.assert_allclose(first.points(frame.xy_from_rowcol(cells)), expected, atol=1e-9)
    np.testing.assert_allclose(first.frame(frame).xy_from_rowcol(cells), expected, atol=1e-9)
    assert -math.pi <= first.yaw <= math.pi


PLACE = (0.25, (1.5, -2.0, 0.4))
GRAYS = OccupancyGrid([[-1, 64, 65, 100]], *PLACE)


@given(masks(35))
def test_the_way_there_and_back(mask):
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.shape == mask.shape
    assert np.array_equal(bits.to_mask(), mask)
    assert np.array_equal(bits.to_occupancy().occupancy, mask * np.int8(100))
    assert np.array_equal(BitMap.from_occupancy(bits.to_occupancy()).packed, bits.packed)
    assert bits.count() == mask.sum()
    assert bits.frame == OccupancyGrid(mask * np.int8(100), *PLACE).frame
    # every bit is where the document says, and the others are 0, whatever is given
    packed = bits.packed
    assert packed.shape == (mask.shape[0], -(-mask.shape[1] // 8))
    for row, col in np.ndindex(mask.shape):
        assert (packed[row, col // 8] >> (7 - col % 8)) & 1 == mask[row, col]
    full = np.packbits(np.ones(mask.shape, bool), axis=1)
    assert not (packed & ~full).any()
    assert np.array_equal(bits.fill().packed, full)
    assert not bits.fill(False).packed.any()
    all_set = np.full(packed.shape, 0xFF, np.uint8)
    assert np.array_equal(BitMap(all_set, mask.shape[1], *PLACE).packed, full)
    assert (all_set == 0xFF).all()


@given(masks(35), st.data())
def test_get_and_set_of_many_cells(mask, data):
    height, width = mask.shape
    cell = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    cells, value = data.draw(st.lists(cell, max_size=20)), data.draw(st.booleans())
    bits = BitMap.from_mask(mask, *PLACE)
    assert bits.get(cells).tolist() == [mask[cell] for cell in cells]
    beyond = [(height, 0), (0, width), (-1, 0)]
    assert bits.contains([*cells, *beyond]).tolist() == [True] * len(cells) + [False] * 3
    expected = mask.copy()
    for cell in cells:
        expected[cell] = value
    assert np.array_equal(bits.set(cells, value).to_mask(), expected)
    assert np.array_equal(bits.to_mask(), mask)


@pytest.mark.parametrize(("bits", "expected"), [
    (BitMap.from_mask([[-1, 0, 1, 100]], *PLACE), [0, 0, 1, 1]),
    (BitMap.from_mask(np.array([[0, 1, 254, 255]], np.uint8), *PLACE), [0, 1, 1, 1]),
    (BitMap.from_mask([[0.0, 0.2, -0.5, math.inf]], *PLACE), [0, 1, 0, 1]),
    (BitMap.from_occupancy(GRAYS), [0, 0, 0, 1]),
    (BitMap.from_occupancy(GRAYS, lethal_threshold=65), [0, 0, 1, 1]),
])  # fmt: skip
def test_any_value_above_0_or_up_to_a_threshold_is_a_1(bits, expected):
    assert bits.to_mask()[0].tolist() == expected


def test_cells_are_cleared_by_shapes_and_never_in_place():
    bits = BitMap.from_mask(np.ones((5, 11)), *PLACE)
    ends = bits.frame.xy_from_rowcol([[1, 2], [1, 8]])
    assert bits.line(ends, value=False).count() == 55 - 7
    assert bits.circle(tuple(ends[0]), 0.0, value=False).count() == 55 - 1
    copy = bits.copy()
    assert not np.shares_memory(bits.packed, copy.packed)
    assert (np.array_equal(bits.packed, copy.packed), copy.frame) == (True, bits.frame)
    with pytest.raises(ValueError, match="read-only"):
        bits.packed[0, 0] = 0


def test_figures_of_a_bit_map_count_its_cells_and_not_its_padding():
    mask = np.zeros((3, 11), bool)
    mask[0, :4] = mask[2, 10] = True
    figures = BitMap.from_mask(mask, *PLACE).figures()
    names = ("occupied", "free", "unknown", "between", "width", "height")
    assert [figures[name] for name in names] == [5, 28, 0, 0, 11, 3]
