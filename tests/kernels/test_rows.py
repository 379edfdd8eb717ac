import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels.rows import MadeRows, Room, counts_of_rows, looked_up, slabs_of
from mapdeal.kernels.threads import use_threads

WHOLE = np.arange(23 * 4).reshape(23, 4).astype(np.uint8)


def made(together=5, keep=0, asked=None):
    def make(first, end):
        if asked is not None:
            asked.append((first, end))
        return WHOLE[first:end]

    return MadeRows(WHOLE.shape, np.uint8, make, together=together, keep=keep)


@given(
    st.integers(-30, 30), st.integers(-30, 30), st.integers(1, 30), st.integers(0, 3)
)  # fmt: skip
def test_any_slice_is_that_of_the_array(first, end, together, keep):
    rows = made(together, keep)
    assert np.array_equal(rows[first:end], WHOLE[first:end])
    assert rows[first:end].dtype == WHOLE.dtype


def test_it_says_what_it_is():
    rows = made()
    assert (rows.shape, rows.ndim, len(rows)) == ((23, 4), 2, 23)
    assert (rows.dtype, rows.nbytes) == (np.uint8, WHOLE.nbytes)
    assert [(s.start, s.stop) for s in rows.slabs()] == [
        (0, 5), (5, 10), (10, 15), (15, 20), (20, 23)
    ]  # fmt: skip
    with pytest.raises(IndexError):
        rows[::2]


def test_kept_slabs_are_made_whole_and_once():
    asked = []
    rows = made(keep=2, asked=asked)
    rows[3:7], rows[4:6], rows[9:10]
    assert asked == [(0, 5), (5, 10)]
    rows[22:]
    rows[0:1]  # gone: two are kept, and two others were asked for since
    assert asked == [(0, 5), (5, 10), (20, 23), (0, 5)]


def test_a_slab_that_two_threads_ask_for_is_made_once():
    begun, may_end, count = threading.Event(), threading.Event(), []

    def make(first, end):
        count.append(first)
        begun.set()
        assert may_end.wait(10)
        return WHOLE[first:end]

    rows = MadeRows(WHOLE.shape, np.uint8, make, together=23, keep=1)
    with ThreadPoolExecutor(2) as pool:
        one = pool.submit(lambda: rows[0:3])
        assert begun.wait(10)
        other = pool.submit(lambda: rows[2:9])
        may_end.set()
        assert np.array_equal(one.result(), WHOLE[0:3])
        assert np.array_equal(other.result(), WHOLE[2:9])
    assert count == [0]


def test_an_error_is_raised_to_whoever_asks_and_not_kept():
    outcomes = iter([OSError("gone"), None])

    def make(first, end):
        problem = next(outcomes)
        if problem:
            raise problem
        return WHOLE[first:end]

    rows = MadeRows(WHOLE.shape, np.uint8, make, together=23, keep=1)
    with pytest.raises(OSError, match="gone"):
        rows[0:3]
    assert np.array_equal(rows[0:3], WHOLE[0:3])


def test_tables_and_counts_work_on_both_kinds():
    table = np.roll(np.arange(256), 3).astype(np.int8)
    for rows in (WHOLE, made()):
        assert np.array_equal(looked_up(rows, table)[:], table[WHOLE])
        assert looked_up(rows, table).dtype == np.int8
        assert counts_of_rows(rows).tolist() == np.bincount(WHOLE.ravel(), minlength=256).tolist()
        assert sum(len(rows[part]) for part in slabs_of(rows)) == 23


def test_changed_rows_are_made_of_the_rows_asked_for():
    doubled = made(keep=1).mapped(np.int64, lambda part: 2 * part.astype(np.int64))
    assert np.array_equal(doubled[7:12], 2 * WHOLE[7:12].astype(np.int64))


@pytest.mark.parametrize(("size", "times"), [(23 * 4 * 8, 1), (23 * 4 * 8 - 1, 2)])
def test_a_layer_is_kept_whole_if_there_is_room(size, times):
    asked = []

    def make(first, end):
        asked.append(first)
        return WHOLE[first:end].astype(np.int64)

    source = MadeRows(
        WHOLE.shape, np.uint8, lambda a, b: WHOLE[a:b], together=5, room=Room(size)
    )  # fmt: skip
    with use_threads(1):
        layer = source.slab_by_slab(np.int64, make)
    for _ in range(2):
        pieces = [layer[first : first + 3] for first in range(0, 23, 3)]
        assert np.array_equal(np.vstack(pieces), WHOLE)
    assert asked == [0, 5, 10, 15, 20] * times
    assert (layer.together, layer.dtype) == (5, np.int64)


def test_room_is_shared_by_all_layers_of_a_map():
    room = Room(100)
    source = MadeRows((10, 4), np.uint8, lambda a, b: WHOLE[a:b], together=5, room=room)
    layer = source.slab_by_slab(np.uint8, lambda a, b: WHOLE[a:b])
    layer.like(np.int8, lambda a, b: WHOLE[a:b], (10, 3)).slab_by_slab(
        np.int8, lambda a, b: WHOLE[a:b, :3]
    )
    assert room.take(30)
    assert not room.take(1)


def test_nobody_can_change_what_others_are_given_too():
    rows = MadeRows(
        (4, 3), np.uint8, lambda a, b: np.zeros((b - a, 3), np.uint8), together=2, keep=1
    )
    with pytest.raises(ValueError, match="read-only"):
        rows[0:2][0, 0] = 1
