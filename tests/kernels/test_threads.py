import errno
import threading
from concurrent.futures import CancelledError

import pytest
from hypothesis import given, strategies as st

from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.kernels import engine
from mapdeal.kernels.threads import (
    CELLS_WORTH_A_THREAD,
    ThreadPool,
    Worker,
    for_rows,
    in_parallel,
    thread_count,
    use_threads,
)


@pytest.mark.parametrize("available", [0, 2, 100])
@pytest.mark.parametrize(("threads", "count"), [(1, 100), (2, 0), (2, 1), (7, 3), (7, 1000)])
def test_the_parts_are_all_of_the_work_once(scarce_threads, available, threads, count):
    scarce_threads(available)
    parts = []
    with use_threads(threads):
        in_parallel(lambda first, end: parts.extend(range(first, end)), count)
    assert sorted(parts) == list(range(count))


@pytest.mark.parametrize("shape", [(1, 1), (3000, 7), (2, 300_000), (1001, 999)])
def test_bands_of_rows_are_all_rows_once(shape):
    rows_seen = []
    with use_threads(3):
        for_rows(lambda rows: rows_seen.extend(range(rows.start, rows.stop)), shape)
    assert sorted(rows_seen) == list(range(shape[0]))


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


@pytest.mark.parametrize("available", [0, 1, 3, 100])
@pytest.mark.parametrize("size", [0, 1, 4])
def test_all_work_is_done_whatever_threads_there_are(scarce_threads, available, size):
    scarce_threads(available)
    names = set()

    def square(number):
        names.add(threading.current_thread().name)
        return number**2

    with ThreadPool(size) as pool:
        futures = [pool.submit(square, k) for k in range(50)]
        assert [future.result(timeout=60) for future in futures] == [k**2 for k in range(50)]
    assert len(names) <= max(1, min(size, available))
    assert (threading.current_thread().name in names) == (min(size, available) == 0)


@pytest.mark.parametrize("available", [0, 1])
def test_an_error_is_raised_where_the_result_is_asked_for(scarce_threads, available):
    scarce_threads(available)
    with ThreadPool(2) as pool:
        failing, fine = pool.submit(int, "x"), pool.submit(int, "3")
        assert fine.result(timeout=60) == 3
        with pytest.raises(ValueError, match="invalid literal"):
            failing.result(timeout=60)


def test_work_goes_on_at_the_same_time():
    barrier = threading.Barrier(3)
    with ThreadPool(3) as pool:
        for future in [pool.submit(barrier.wait, 60) for _ in range(3)]:
            future.result(timeout=60)


def busy(size):
    may_end, began, pool = threading.Event(), threading.Event(), ThreadPool(size)

    def work():
        began.set()
        return may_end.wait(60)

    first = pool.submit(work)
    assert began.wait(60)
    return pool, first, may_end


def test_what_is_not_begun_can_be_dropped():
    pool, first, may_end = busy(1)
    waiting = [pool.submit(int) for _ in range(5)]
    threading.Timer(0.01, may_end.set).start()
    pool.shutdown(cancel_futures=True)
    assert first.result() is True
    for future in waiting:
        with pytest.raises(CancelledError):
            future.result()


@pytest.mark.parametrize("starts_first", [True, False])
def test_an_interrupt_while_a_thread_is_started_does_not_hang_the_end(monkeypatch, starts_first):
    start = Worker.start

    def interrupted(thread):
        if starts_first:
            start(thread)
        raise KeyboardInterrupt

    pool, first, may_end = busy(3)
    monkeypatch.setattr(Worker, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pool.submit(int)
    threading.Timer(0.1, may_end.set).start()
    end = threading.Thread(target=pool.shutdown, kwargs={"cancel_futures": True}, daemon=True)
    end.start()
    end.join(20)
    assert not end.is_alive()
    assert first.result() is True


def test_no_thread_is_started_that_would_have_no_memory_to_begin(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr("mmap.mmap", refuse)
    names = []
    with use_threads(4):
        in_parallel(lambda *_: names.append(threading.current_thread().name), 8)
    assert set(names) == {threading.current_thread().name}


def test_a_thread_that_finds_no_memory_to_begin_with_is_not_waited_for(monkeypatch):
    started, parts = [], []
    monkeypatch.setattr("mapdeal.kernels.threads.start_new_thread", lambda *_: started.append(1))
    monkeypatch.setattr("mapdeal.kernels.threads._LONGEST_START", 0.2)

    def all_of_it():
        with use_threads(4):
            in_parallel(lambda first, end: parts.extend(range(first, end)), 64)
        with ThreadPool(2) as pool:
            parts.append(pool.submit(int, "64").result(20))

    thread = threading.Thread(target=all_of_it, daemon=True)
    thread.start()
    thread.join(20)
    assert not thread.is_alive()
    assert parts == list(range(65))
    assert len(started) == 2


def test_a_thread_that_begins_after_it_was_given_up_does_no_work(monkeypatch):
    late, parts = [], []
    monkeypatch.setattr("mapdeal.kernels.threads.start_new_thread", lambda *call: late.append(call))
    monkeypatch.setattr("mapdeal.kernels.threads._LONGEST_START", 0.01)
    worker = Worker(lambda: parts.append("late"))
    assert not worker.start()
    ((begin, arguments),) = late
    begin(*arguments)
    worker.join()
    assert parts == []


@pytest.mark.parametrize(("requested", "is_built", "name"), [
    ("scipy", True, "scipy"), ("scipy", False, "scipy"), ("compiled", True, "compiled"),
    ("", True, "compiled"), ("", False, "scipy"), (None, True, "compiled"),
])  # fmt: skip
def test_the_engine_is_that_of_the_variable(monkeypatch, requested, is_built, name):
    monkeypatch.setattr(engine, "compiled_module", lambda: engine if is_built else None)
    if requested is None:
        monkeypatch.delenv(engine.VARIABLE, raising=False)
    else:
        monkeypatch.setenv(engine.VARIABLE, requested)
    assert engine.engine_name() == name


@pytest.mark.parametrize("requested", ["compiled", "numpy", "SCIPY"])
def test_an_unknown_engine_is_refused(monkeypatch, requested):
    monkeypatch.setattr(engine, "compiled_module", lambda: None)
    monkeypatch.setenv(engine.VARIABLE, requested)
    with pytest.raises(ParameterError, match=engine.VARIABLE):
        engine.engine_name()


@needs_compiled
@given(
    st.sampled_from([0.05, 0.1, 0.25, 1 / 3]),
    st.tuples(*[st.floats(-1e6, 1e6)] * 2, st.floats(-4, 4)),
    st.lists(st.tuples(*[st.integers(-400, 400).map(lambda k: k / 8)] * 2), min_size=1),
)
def test_both_engines_find_the_same_cells_on_edges_too(resolution, origin, places):
    frame = Frame(3, 5, resolution, origin)
    points = frame.xy_from_continuous_rowcol(places)
    compiled, by_numpy = by_each_engine(lambda: frame.unbounded_rowcol_from_xy(points))
    assert compiled.tolist() == by_numpy.tolist()
    assert compiled.dtype == by_numpy.dtype
