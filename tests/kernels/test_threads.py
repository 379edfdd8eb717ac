import threading

import pytest

from mapdeal.kernels.threads import (
    CELLS_WORTH_A_THREAD,
    for_rows,
    in_parallel,
    thread_count,
    use_threads,
)


@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize("count", [0, 1, 3, 100])
def test_the_parts_are_all_of_the_work_once(threads, count):
    done = []
    with use_threads(threads):
        in_parallel(lambda first, end: done.extend(range(first, end)), count)
    assert sorted(done) == list(range(count))


@pytest.mark.parametrize("shape", [(1, 1), (5, 3), (3000, 7), (2, 300_000), (1001, 999)])
def test_bands_of_rows_are_all_rows_once(shape):
    seen = []
    with use_threads(3):
        for_rows(lambda rows: seen.extend(range(rows.start, rows.stop)), shape)
    assert sorted(seen) == list(range(shape[0]))


def test_small_arrays_start_no_threads():
    names = set()
    side = int(CELLS_WORTH_A_THREAD**0.5) - 1
    with use_threads(4):
        for_rows(lambda _: names.add(threading.current_thread().name), (side, side))
    assert names == {threading.current_thread().name}


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_in_any_part_is_raised_to_the_caller(threads):
    def fail(first, end):
        if first <= 57 < end:
            raise KeyError(57)

    with use_threads(threads), pytest.raises(KeyError, match="57"):
        in_parallel(fail, 100)


def test_the_setting_reaches_the_threads_that_work_and_ends_with_its_block():
    before = thread_count()
    counts = set()
    with use_threads(3):
        in_parallel(lambda *_: counts.add(thread_count()), 50)
        with use_threads(None):
            assert thread_count() == 3
    assert counts == {3}
    assert thread_count() == before
