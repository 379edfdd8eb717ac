import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal.kernels.distance import (
    bytes_by_distance,
    signed_distance,
    signed_squared_distance,
    squared_distance,
    unreachable,
    within_distance,
)
from mapdeal.kernels.threads import use_threads
from strategies import masks

pytestmark = pytest.mark.usefixtures("each_engine")


def maps(side, density, seed=0):
    """Random cells, with a part of each map left empty so that long distances occur."""
    marked = np.random.default_rng(seed).random((side, side + side // 7)) < density
    marked[: side // 3, side // 4 :] = False
    return marked


@given(masks())
def test_squared_distance_equals_brute_force(marked):
    expected = oracles.squared_distance(marked)
    squared = squared_distance(marked)
    if not marked.any():
        assert (squared == unreachable(squared)).all()
    else:
        assert np.array_equal(squared, expected)


@given(masks())
def test_signed_squares_are_positive_outside_and_negative_inside(occupied):
    signed = signed_squared_distance(occupied)
    outside, inside = oracles.squared_distance(occupied), oracles.squared_distance(~occupied)
    far = unreachable(signed)
    for index in np.ndindex(occupied.shape):
        side = inside if occupied[index] else outside
        expected = far if side[index] is None else side[index]
        assert signed[index] == (-expected if occupied[index] else expected)


@given(masks(), st.integers(0, 300))
def test_a_limit_makes_what_lies_beyond_unreachable(marked, limit):
    endless = np.iinfo(np.int32).max
    for cut_off, whole in [
        (squared_distance(marked, limit=limit), squared_distance(marked)),
        (signed_squared_distance(marked, limit=limit), signed_squared_distance(marked)),
    ]:
        far = np.abs(whole) > limit
        assert np.array_equal(cut_off, np.where(far, np.sign(whole) * endless, whole))


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0, 1, 5, 36, 9215, 9216, 9217, 30_975, 30_976, 30_977, 60_000])
@pytest.mark.parametrize("density", [0.5, 3e-4])
def test_limits_hold_at_every_distance(limit, density):
    marked = maps(370, density)
    whole = oracles.squared_distance_by_columns(marked)
    expected = np.where(whole > limit, np.iinfo(np.int32).max, whole)
    assert np.array_equal(squared_distance(marked, limit=limit), expected)


@given(masks(), st.integers(1, 200), st.randoms(use_true_random=False))
def test_bytes_are_those_of_the_squares(marked, entries, random):
    table = np.array([random.randrange(256) for _ in range(entries + 1)], dtype=np.uint8)
    squares = squared_distance(marked)
    assert np.array_equal(bytes_by_distance(marked, table), table[np.minimum(squares, entries)])


@given(masks(), st.integers(0, 30) | st.just(1 << 21))
def test_within_a_distance_is_a_threshold_on_squares(marked, square):
    expected = np.array(
        [s is not None and s <= square for s in oracles.squared_distance(marked).flat]
    )
    assert np.array_equal(within_distance(marked, square).ravel(), expected)


@given(masks())
def test_signed_distances_round_the_exact_root_once(occupied):
    distance = signed_distance(occupied, scale=0.25, inside_shift=0.25)
    for index, square in np.ndenumerate(signed_squared_distance(occupied)):
        if abs(square) == np.iinfo(np.int32).max:
            expected = math.inf if square > 0 else -math.inf
        else:
            metres = math.sqrt(abs(int(square))) * 0.25  # a power of two: one rounding
            expected = np.float32(metres if square > 0 else 0.25 - metres)
        assert distance[index] == expected


@pytest.mark.parametrize("clip", [math.inf, 2.0, 4.79, 4.81, 30.0])
def test_shifts_clip_and_gain_act_in_this_order(clip):
    occupied = maps(250, 4e-4)
    squares = signed_squared_distance(occupied)
    distance = signed_distance(
        occupied, scale=0.05, outside_shift=-0.025, inside_shift=0.025, clip=clip, gain=3.0
    )
    metres = np.sqrt(np.abs(squares).astype(np.float64)) * 0.05
    free = 3.0 * np.clip(metres - 0.025, -clip, clip)
    inside = np.clip(0.025 - metres, -clip, clip)
    assert np.array_equal(distance, np.where(squares > 0, free, inside).astype(np.float32))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "density"),
    [(450, 0.0), (450, 5e-6), (420, 1e-4), (400, 0.01), (333, 0.5), (333, 0.99), (450, 0.99999)],
)
def test_long_distances_equal_an_independent_transform(side, density):
    marked = maps(side, density, seed=side)
    marked[-1, -1] = True
    assert np.array_equal(squared_distance(marked), oracles.squared_distance_by_columns(marked))


@pytest.mark.parametrize("width", [31, 32, 33, 63, 64, 65, 95, 97, 127, 129, 193])
def test_rows_that_end_within_a_block(width):
    marked = np.zeros((5, width), dtype=bool)
    marked[3, width - 1] = True
    expected = oracles.squared_distance_by_columns(marked)
    assert np.array_equal(squared_distance(marked), expected)
    inside = signed_squared_distance(~marked)
    assert np.array_equal(-inside[~marked], expected[~marked])


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_a_grid_without_cells_gives_none(shape):
    empty = np.zeros(shape, dtype=bool)
    assert squared_distance(empty).shape == shape
    assert signed_distance(empty).shape == shape
    assert bytes_by_distance(empty, np.zeros(3, np.uint8)).shape == shape


@pytest.mark.parametrize("mask", [np.zeros((3, 3), np.uint8), np.zeros(3, bool), np.eye(3)])
def test_what_is_no_mask_is_refused(mask):
    with pytest.raises(ValueError, match="must be a bool array with two axes"):
        squared_distance(mask)


def test_limits_and_tables_that_cannot_be_are_refused():
    mask = np.ones((2, 2), dtype=bool)
    with pytest.raises(ValueError, match="at least 0"):
        squared_distance(mask, limit=-1)
    with pytest.raises(ValueError, match="two entries"):
        bytes_by_distance(mask, np.zeros(1, np.uint8))


def test_far_stretches_beside_columns_without_obstacle_take_the_nearest():
    occupied = np.zeros((300, 1500), dtype=bool)
    occupied[5::97, 150::311] = True
    occupied[200:, 700:] = False
    expected = oracles.squared_distance_by_columns(occupied)
    assert np.array_equal(squared_distance(occupied), expected)


@pytest.mark.parametrize("shape", [(1, 46_400), (46_400, 1), (2, 32_767), (32_768, 2)])
def test_squares_beyond_32_bits_do_not_overflow(shape):
    marked = np.zeros(shape, dtype=bool)
    marked[0, 0] = True
    squared = squared_distance(marked)
    assert squared[-1, -1] == (shape[0] - 1) ** 2 + (shape[1] - 1) ** 2
    assert squared.dtype == (np.int32 if max(shape) <= 32_767 else np.int64)
    assert signed_distance(marked)[-1, -1] == np.float32(math.hypot(shape[0] - 1, shape[1] - 1))


@pytest.mark.parametrize("shape", [(1, 1_600_000), (1_600_000, 1)])
def test_sides_of_millions_of_cells(shape):
    marked = np.zeros(shape, dtype=bool)
    marked[0, 0] = True
    assert squared_distance(marked)[-1, -1] == 1_599_999**2


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_number_of_threads_makes_no_difference(threads):
    marked = maps(600, 1e-3)
    with use_threads(threads):
        squares = signed_squared_distance(marked)
    assert np.array_equal(squared_distance(marked), np.maximum(squares, 0))


def test_the_input_is_not_touched_and_may_be_any_view():
    marked = np.array([[True, False, False], [False, False, True], [False, True, False]])[::-1, ::2]
    before = marked.copy()
    marked.flags.writeable = False
    squared_distance(marked)
    signed_distance(marked)
    bytes_by_distance(marked, np.zeros(5, dtype=np.uint8))
    assert np.array_equal(signed_squared_distance(marked), signed_squared_distance(before))
    assert np.array_equal(marked, before)


@pytest.mark.parametrize("reach", [3, 96, 97, 176, 177, 200])
def test_a_table_s_last_square_is_one_of_it_and_the_next_is_beyond(reach):
    marked = np.zeros((1, 450), bool)
    marked[0, 0] = True
    table = np.full(reach * reach + 2, 7, np.uint8)
    table[-2], table[-1] = 8, 9
    found = bytes_by_distance(marked, table)[0].tolist()
    assert found == [7] * reach + [8] + [9] * (449 - reach)
