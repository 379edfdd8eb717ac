"""Distances by blocks of rows: exact across borders, whatever the blocks."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

import oracles
from engines import needs_compiled
from mapdeal.kernels import scipy_twins
from mapdeal.kernels.arrays import unreachable
from mapdeal.kernels.distance import (
    bytes_by_distance,
    dilate_square,
    halos_of,
    ringed,
    runs_of,
    signed_distance,
    squared_distance,
    within_distance,
)
from mapdeal.kernels.scipy_twins import row_minima
from mapdeal.kernels.threads import use_threads
from strategies import masks

pytestmark = pytest.mark.usefixtures("each_engine")


def maps(side, density, seed=0):
    """Random cells and a corner, with a part of each map empty so that long distances occur."""
    marked = np.random.default_rng(seed).random((side, side + side // 7)) < density
    marked[: side // 3, side // 4 :] = False
    marked[-1, -1] = True
    return marked


@given(masks())
def test_squares_and_signed_distances_equal_brute_force(occupied):
    outside, inside = oracles.squared_distance(occupied), oracles.squared_distance(~occupied)
    squared, signed = squared_distance(occupied), signed_distance(occupied)
    for cell in np.ndindex(occupied.shape):
        assert squared[cell] == (unreachable(squared) if outside[cell] is None else outside[cell])
        square = inside[cell] if occupied[cell] else outside[cell]
        metres = np.float32(math.inf if square is None else math.sqrt(square))
        assert signed[cell] == (-metres if occupied[cell] else metres)


@given(masks(), st.integers(0, 300))
def test_a_limit_makes_what_lies_beyond_unreachable(marked, limit):
    unlimited = squared_distance(marked)
    expected = np.where(unlimited > limit, np.iinfo(np.int32).max, unlimited)
    assert np.array_equal(squared_distance(marked, limit=limit), expected)


@pytest.mark.slow
def test_limits_hold_at_every_distance():
    marked = maps(370, 3e-4)
    unlimited = oracles.squared_distance_by_columns(marked)
    for limit in (0, 36, 9215, 9216, 9217, 30_975, 30_976, 30_977):
        expected = np.where(unlimited > limit, np.iinfo(np.int32).max, unlimited)
        assert np.array_equal(squared_distance(marked, limit=limit), expected), limit


@given(masks(), st.integers(1, 200), st.randoms(use_true_random=False))
def test_bytes_are_those_of_the_squares(marked, entries, random):
    table = np.array([random.randrange(256) for _ in range(entries + 1)], dtype=np.uint8)
    squares = squared_distance(marked)
    assert np.array_equal(bytes_by_distance(marked, table), table[np.minimum(squares, entries)])


@given(masks(), st.integers(0, 30) | st.just(1 << 21))
def test_within_a_distance_is_a_threshold_on_squares(marked, square):
    expected = [s is not None and s <= square for s in oracles.squared_distance(marked).flat]
    assert within_distance(marked, square).ravel().tolist() == expected


@given(
    masks(), st.sampled_from([0.05, 1.0]) | st.floats(1e-3, 10), st.floats(-1, 1), st.floats(-1, 1),
    st.sampled_from([math.inf, 2.0]) | st.floats(0.01, 30), st.sampled_from([1.0, 3.0, 1.7]),
)  # fmt: skip
def test_shifts_clip_and_gain_act_in_this_order(occupied, scale, outside, inside, clip, gain):
    shifts = {"outside_shift": outside, "inside_shift": inside}
    found = signed_distance(occupied, scale=scale, clip=clip, gain=gain, **shifts)
    squares = np.where(occupied, squared_distance(~occupied), squared_distance(occupied))
    metres = np.sqrt(squares.astype(np.float64)) * scale
    metres[squares == unreachable(squares)] = math.inf
    free = gain * np.clip(metres + outside, -clip, clip)
    within = np.clip(inside - metres, -clip, clip)
    assert np.array_equal(found, np.where(occupied, within, free).astype(np.float32))


FAR_COLUMNS = np.zeros((300, 900), dtype=bool)  # stretches beside columns without an obstacle
FAR_COLUMNS[5::97, 150::311] = True
FAR_COLUMNS[200:, 700:] = False


@pytest.mark.slow
@pytest.mark.parametrize("marked", [
    FAR_COLUMNS, maps(450, 0.0), maps(420, 1e-4, 420), maps(333, 0.5, 333), maps(333, 0.99, 333),
    maps(450, 0.99999, 450),
], ids=np.count_nonzero)  # fmt: skip
def test_long_distances_equal_an_independent_transform(marked):
    expected = oracles.squared_distance_by_columns(marked)
    for threads in (1, 5):
        with use_threads(threads):
            assert np.array_equal(squared_distance(marked), expected)
            metres = np.sqrt(np.where(expected == unreachable(expected), math.inf, expected))
            assert np.array_equal(np.maximum(signed_distance(marked), 0), metres.astype(np.float32))


@pytest.mark.parametrize("width", [31, 32, 33, 63, 64, 65, 95, 97, 127, 129, 193])
def test_rows_that_end_within_a_block(width):
    marked = np.zeros((5, width), dtype=bool)
    marked[3, width - 1] = True
    expected = oracles.squared_distance_by_columns(marked)
    assert np.array_equal(squared_distance(marked), expected)
    inside = signed_distance(~marked)
    assert np.array_equal(-inside[~marked], np.sqrt(expected[~marked], dtype=np.float32))


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_a_grid_without_cells_gives_none(shape):
    empty = np.zeros(shape, dtype=bool)
    assert squared_distance(empty).shape == shape
    assert signed_distance(empty).shape == shape
    assert bytes_by_distance(empty, np.zeros(3, np.uint8)).shape == shape


@pytest.mark.parametrize("shape", [(1, 46_400), (2, 32_767), (32_768, 2), (1, 1_600_000)])
def test_squares_beyond_32_bits_do_not_overflow(shape):
    marked = np.zeros(shape, dtype=bool)
    marked[0, 0] = True
    squared = squared_distance(marked)
    assert squared[-1, -1] == (shape[0] - 1) ** 2 + (shape[1] - 1) ** 2
    assert squared.dtype == (np.int32 if max(shape) <= 32_767 else np.int64)
    assert signed_distance(marked)[-1, -1] == np.float32(math.hypot(shape[0] - 1, shape[1] - 1))


def test_the_input_is_not_touched_and_may_be_any_view():
    marked = np.array([[True, False, False], [False, False, True], [False, True, False]])[::-1, ::2]
    before = marked.copy()
    marked.flags.writeable = False
    squared_distance(marked)
    signed_distance(marked)
    bytes_by_distance(marked, np.zeros(5, dtype=np.uint8))
    assert np.array_equal(squared_distance(marked), squared_distance(before))
    assert np.array_equal(marked, before)


@pytest.mark.parametrize("reach", [3, 96, 97, 176, 177, 200])
def test_a_table_s_last_square_is_one_of_it_and_the_next_is_beyond(reach):
    marked = np.zeros((1, 450), bool)
    marked[0, 0] = True
    table = np.full(reach * reach + 2, 7, np.uint8)
    table[-2], table[-1] = 8, 9
    assert bytes_by_distance(marked, table)[0].tolist() == [7] * reach + [8] + [9] * (449 - reach)


@st.composite
def cut_masks(draw, longest):
    marked = draw(masks(longest))
    inner = draw(st.sets(st.integers(1, len(marked))))
    return marked, [slice(*pair) for pair in itertools.pairwise(sorted({0, len(marked), *inner}))]


def by_blocks(marked, blocks, **measure):
    parts = [marked[block] for block in blocks]
    pairs = zip(parts, halos_of([runs_of(part) for part in parts]), strict=True)
    return np.vstack([signed_distance(part, **measure, halo=halo) for part, halo in pairs])


@given(cut=cut_masks(longest=40), clip=st.sampled_from([np.inf, 0.7]))
def test_blocks_equal_the_whole_bit_for_bit(cut, clip):
    marked, blocks = cut
    shifts = {"outside_shift": 0.0, "inside_shift": 0.05}
    measure = {"scale": 0.05, "clip": clip, "gain": 1.5, **shifts}
    expected = signed_distance(marked, **measure)
    assert by_blocks(marked, blocks, **measure).tobytes() == expected.tobytes()


WIDE = pytest.param((3, 120_000), marks=pytest.mark.thorough)


@pytest.mark.parametrize("shape", [(46_400, 2), WIDE])
def test_squares_beyond_32_bits_are_exact(shape):
    marked = np.zeros(shape, dtype=bool)
    marked[0, 0] = True
    step = -(-shape[0] // 3)
    blocks = [slice(first, first + step) for first in range(0, shape[0], step)]
    measure = {"scale": 1.0, "outside_shift": 0.0, "inside_shift": 0.0}
    expected = np.hypot(*np.indices(shape))
    expected[0, 0] = -1
    for distance in (by_blocks(marked, blocks, **measure), signed_distance(marked, **measure)):
        assert np.array_equal(distance, expected.astype(np.float32))


@given(masks(), st.integers(0, 2**32 - 1))
def test_row_minima_equal_a_look_at_every_column(exists, seed):
    values = np.random.default_rng(seed).integers(0, 200, exists.shape)
    found = row_minima(values, exists)
    height, width = exists.shape
    for row, x in np.ndindex(height, width):
        candidates = [(x - i) ** 2 + int(values[row, i]) for i in range(width) if exists[row, i]]
        assert found[row, x] == min(candidates, default=np.iinfo(np.int64).max)


# Narrow, wide, higher than a band of rows, wider than a strip of cells.
SHAPES = [(1, 1), (1, 700), (150, 1), (200, 90), (70, 1100), (131, 513)]
REACHES = [0, 1, 2, 3, 4, 7, 8, 15, 16, 31, 33, 62, 63, 70]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("density", [0.0, 0.001, 0.2])
def test_large_shapes_equal_those_of_scipy(shape, density):
    marked = np.random.default_rng(7).random(shape) < density
    near = ndimage.distance_transform_cdt(~np.pad(marked, 1), "chessboard")[1:-1, 1:-1]
    squares = ndimage.distance_transform_edt(~marked) ** 2 if marked.any() else np.full(shape, 1e9)
    for reach in REACHES:
        expected = near <= reach if marked.any() else marked
        with use_threads(2):
            assert np.array_equal(dilate_square(marked, reach), expected), reach
            for square in (reach * reach, reach * reach + reach):
                found = within_distance(marked, square)
                assert np.array_equal(found, squares <= square + 1e-6), square
    values = np.full(shape, 5, np.int8)
    costs = list(range(100, 20, -1))
    for count in (1, 4, 63, 64, 80):
        rings = np.where(near < count, np.array(costs)[np.minimum(near, 79)], 5)
        expected = rings if marked.any() else values
        assert np.array_equal(ringed(values, marked, costs[:count]), expected)


MORE_DENSITIES = [pytest.param(d, marks=pytest.mark.thorough) for d in (0.0, 1e-6, 0.1, 0.9999)]
METRIC = {"scale": 0.05, "outside_shift": -0.025, "inside_shift": 0.05, "clip": 0.37, "gain": 1.7}


@pytest.mark.slow
@needs_compiled
@pytest.mark.parametrize("each_engine", ["compiled"], indirect=True)
@pytest.mark.parametrize("density", [1e-4, 0.9, *MORE_DENSITIES])
def test_both_engines_agree_on_1000_x_500_cells(each_engine, density):
    from mapdeal.kernels import compiled

    rng = np.random.default_rng(7)
    marked = rng.random((1000, 500)) < density
    marked[:500, 50:325] = density > 0.5
    for name, arguments in [
        ("squares", {"limit": None}),
        ("squares", {"limit": 40_000}),
        ("metres", METRIC),
        ("metres", METRIC | {"clip": math.inf, "gain": 1.0}),
        ("bytes_of_squares", {"table": rng.integers(0, 256, 40_002, dtype=np.uint8)}),
    ]:
        ours, twin = (getattr(each, name)(marked, **arguments) for each in (compiled, scipy_twins))
        assert ours.dtype == twin.dtype, name
        assert ours.tobytes() == twin.tobytes(), name
