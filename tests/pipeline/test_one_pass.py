"""One pass through a lazy layer for all files that are made of it."""

import errno
import gc
import weakref
from contextlib import contextmanager

import numpy as np
import pytest

from mapdeal import FileAccessError, OccupancyGrid
from mapdeal.files.transaction import RowsWriter, Transaction
from mapdeal.kernels.blocks import CacheBudget, LazyLayer, report_rows, rows_reported
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline import inputs as memory
from mapdeal.pipeline.folder import one_pass
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings, passes_reported
from mapdeal.stages import costmap_2d, esdf as esdf_module
from pipeline.reported import write_cells

VALUES = np.random.default_rng(5).integers(-1, 101, (23, 4)).astype(np.int8)


def lazy_grid(requested):
    def make(rows):
        requested.append((rows.start, rows.stop))
        return VALUES[rows]

    return OccupancyGrid(LazyLayer(VALUES.shape, np.int8, make, block_height=5, keep=1), 0.1)


def by_rows(grid):
    return RowsWriter(grid.layer, lambda file: (
        lambda rows: file.write(grid.layer[rows].tobytes()), lambda: file.write(b"END"),
    ))  # fmt: skip


def asking(grid, count):
    """A writer that goes through some rows itself, and twice through the first of them."""
    firsts = (0, *range(0, count, 5))
    return lambda file: [file.write(grid.layer[k : min(k + 5, 23)].tobytes()) for k in firsts]


@pytest.mark.parametrize(("passes", "last"), [(1, 131), (2, 1131)])
def test_progress_is_that_of_rows_and_ends_where_no_further_row_is_computed(passes, last):
    steps = []

    @contextmanager
    def progress(most):
        yield steps.append
        assert sum(steps) == most == 1000 * passes

    grid = lazy_grid([])
    with passes_reported(progress, passes):
        for rows in (slice(0, 10), slice(10, 15), slice(15, 20)):
            report_rows(grid.layer, rows)
    assert steps == [434, 218, 217, last]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [0, 10, 23])
def test_all_files_are_whole_and_each_row_is_made_once(tmp_path, threads, count):
    requested, reports = [], []
    paths = [tmp_path / name for name in "abc"]
    grid = lazy_grid(requested)
    with (
        use_threads(threads),
        rows_reported(lambda rows, height: reports.append((rows, height))),
        Transaction(paths) as transaction,
        one_pass(transaction, grid) as shared,
    ):
        transaction.write(paths[0], by_rows(grid))
        transaction.write(paths[1], asking(shared, count))
        transaction.write(paths[2], by_rows(grid))
    content = VALUES.tobytes() + b"END"
    again = VALUES[:5].tobytes() + VALUES[:count].tobytes()
    assert [path.read_bytes() for path in paths] == [content, again, content]
    in_order = [(0, 5), (5, 10), (10, 15), (15, 20), (20, 23)]
    assert [rows for rows in requested if rows != (0, 5)] == in_order[1:]
    assert sum(rows for rows, _ in reports) == 23
    assert {height for _, height in reports} == {23}


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("where", ["begin", "rows", "finish", "asking"])
def test_the_message_of_a_full_disk_names_the_file_that_did_not_fit(tmp_path, threads, where):
    grid = lazy_grid([])
    good, bad = tmp_path / "good", tmp_path / "bad"

    def fail(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def begin(_):
        if where == "begin":
            fail()
        write_rows = fail if where == "rows" else lambda _: None
        return write_rows, fail if where == "finish" else lambda: None

    with (
        pytest.raises(FileAccessError, match=r"bad: cannot be written: No space left"),
        use_threads(threads),
        Transaction([good, bad]) as transaction,
        one_pass(transaction, grid) as shared,
    ):
        transaction.write(good, asking(shared, 23))
        transaction.write(bad, fail if where == "asking" else RowsWriter(grid.layer, begin))
    assert list(tmp_path.iterdir()) == []


CELLS = 613 * 701


@pytest.fixture
def building(tmp_path):
    values = np.where(np.random.default_rng(3).random((613, 701)) < 0.002, 100, 0).astype(np.int8)
    values[:40] = -1
    return write_cells(tmp_path / "map.yaml", values, 0.1)


@pytest.mark.parametrize(("room", "expected"), [
    (0, {"distances": 4 * 613, "costs": 2 * 613}),  # for figures, and for all files
    (2 * CELLS, {"distances": 3 * 613, "costs": 613}),  # the inflated map is kept, and costs
    (9 * CELLS, {"distances": 613, "costs": 613}),
])  # fmt: skip
def test_layers_are_made_once_for_figures_and_once_for_all_files_and_then_released(
    building, tmp_path, monkeypatch, room, expected
):
    layers, set_up = weakref.WeakSet(), LazyLayer.__init__
    monkeypatch.setattr(LazyLayer, "__init__", lambda layer, *args, **options: (
        layers.add(layer), set_up(layer, *args, **options)
    )[1])  # fmt: skip
    counts = {"distances": 0, "costs": 0}

    def count(kind, owner, name, rows_of):
        method = getattr(owner, name)

        def counted(*args, **kwargs):
            counts[kind] += rows_of(*args)
            return method(*args, **kwargs)

        monkeypatch.setattr(owner, name, counted)

    in_blocks = memory.MemoryPlan(0, memory.BlockPlan(40, CacheBudget(room)))
    count("distances", esdf_module, "signed_distance", len)
    count("costs", costmap_2d, "base_costs", lambda _, __, rows: rows.stop - rows.start)
    monkeypatch.setattr(memory, "_plan_memory", lambda *_: in_blocks)
    settings = Settings(threads=1, images=False)
    gc.disable()
    run_map(building, tmp_path / "out", load_recipe("default"), settings)
    is_released = not layers
    gc.enable()
    assert counts == expected
    assert is_released  # nothing but references counts, so that maps of a batch do not add up
