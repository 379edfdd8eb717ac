import threading
from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal.kernels import blocks
from mapdeal.kernels.threads import use_threads

ALL_ROWS = np.arange(23 * 4).reshape(23, 4).astype(np.uint8)


def lazy(block_height=5, keep=0, requested=None, make=ALL_ROWS.__getitem__, **options):
    """Return a lazy layer of ALL_ROWS that appends the rows it makes to `requested`."""

    def listed(rows):
        if requested is not None:
            requested.append((rows.start, rows.stop))
        return make(rows)

    return blocks.LazyLayer(
        ALL_ROWS.shape, np.uint8, listed, block_height=block_height, keep=keep, **options
    )


@given(st.integers(-30, 30), st.integers(-30, 30), st.integers(1, 30), st.integers(0, 3))
def test_any_slice_is_that_of_the_array(first, end, block_height, keep):
    layer = lazy(block_height, keep)
    assert np.array_equal(layer[first:end], ALL_ROWS[first:end])
    assert layer[first:end].dtype == ALL_ROWS.dtype


def test_kept_blocks_are_made_whole_and_once():
    requested = []
    layer = lazy(keep=2, requested=requested)
    layer[3:7], layer[4:6], layer[9:10]
    assert requested == [(0, 5), (5, 10)]
    layer[22:]
    layer[0:1]  # gone: two are kept, and two others were asked for since
    assert requested == [(0, 5), (5, 10), (20, 23), (0, 5)]


def test_a_block_that_two_threads_ask_for_is_made_once():
    begun, may_end, requested = threading.Event(), threading.Event(), []

    def make(rows):
        begun.set()
        assert may_end.wait(120)
        return ALL_ROWS[rows]

    layer = lazy(23, keep=1, requested=requested, make=make)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(lambda: layer[0:3])
        assert begun.wait(120)
        second = pool.submit(lambda: layer[2:9])
        may_end.set()
        assert np.array_equal(first.result(), ALL_ROWS[0:3])
        assert np.array_equal(second.result(), ALL_ROWS[2:9])
    assert requested == [(0, 23)]


def test_an_error_is_raised_to_each_caller_and_not_cached():
    outcomes = mock.Mock(side_effect=[OSError("gone"), ALL_ROWS])
    layer = lazy(23, keep=1, make=outcomes)
    with pytest.raises(OSError, match="gone"):
        layer[0:3]
    assert np.array_equal(layer[0:3], ALL_ROWS[0:3])


def test_a_lazy_layer_can_be_had_whole_and_is_never_compared_by_accident():
    layer = lazy(keep=1)
    assert np.array_equal(np.asarray(layer), ALL_ROWS)
    assert np.asarray(layer, dtype=np.int64).dtype == np.int64
    for wrong in (
        lambda: layer == 3,
        lambda: layer > 3,
        lambda: layer + ALL_ROWS,
        lambda: layer[3],
    ):
        with pytest.raises((TypeError, AttributeError)):
            wrong()


@given(st.integers(1, 30), st.integers(0, 30))
def test_a_window_has_its_halo_and_gives_its_rows(block_height, halo):
    def largest_around(layer):
        def change(rows):
            part = layer[rows].astype(np.int64)
            reached = [part[max(k - halo, 0) : k + halo + 1].max(axis=0) for k in range(len(part))]
            return np.array(reached)

        return change

    layer = lazy(block_height)
    expected = np.array([ALL_ROWS[max(k - halo, 0) : k + halo + 1].max(axis=0) for k in range(23)])
    for source in (ALL_ROWS, layer):
        product = blocks.made_by_windows(source, np.int64, largest_around(source), halo=halo)
        assert blocks.is_lazy(product) == (source is layer)
        assert np.array_equal(product[:], expected)
        assert np.array_equal(product[4:9], expected[4:9])


@pytest.mark.parametrize(("size", "times"), [(23 * 4 * 8, 1), (23 * 4 * 8 - 1, 2)])
def test_a_layer_is_kept_whole_if_the_budget_has_room(size, times):
    requested = []
    source = lazy(requested=requested, budget=blocks.CacheBudget(size))
    with use_threads(1):
        layer = blocks.made_by_rows(source, np.int64, lambda rows: source[rows] + 0, is_cached=True)
    for _ in range(2):
        pieces = [layer[first : first + 3] for first in range(0, 23, 3)]
        assert np.array_equal(np.vstack(pieces), ALL_ROWS)
    assert [first for first, _ in requested] == [0, 5, 10, 15, 20] * times
    assert (layer.block_height, layer.dtype) == (5, np.int64)


def test_passes_through_lazy_layers_report_rows_that_are_done():
    reports = []
    with blocks.rows_reported(lambda rows, height: reports.append((rows, height))):
        for rows in blocks.swept(lazy()):
            assert sum(count for count, _ in reports) == rows.start
        for _ in blocks.swept(ALL_ROWS):
            pass
    assert reports == [(5, 23)] * 4 + [(3, 23)]
    for _ in blocks.swept(lazy()):
        pass
    assert len(reports) == 5


def test_the_budget_is_shared_by_all_layers_of_a_map():
    budget = blocks.CacheBudget(23 * 4 + 23 * 3 + 1)
    layer = blocks.made_by_rows(lazy(budget=budget), np.uint8, ALL_ROWS.__getitem__, is_cached=True)
    narrow = blocks.made_by_rows(layer, np.int8, lambda rows: ALL_ROWS[rows, :3], shape=(23, 3))
    blocks.made_by_rows(narrow, np.int8, lambda rows: ALL_ROWS[rows, :3], is_cached=True)
    assert budget.take(1)
    assert not budget.take(1)
