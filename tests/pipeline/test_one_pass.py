"""One pass through a lazy layer for all files that are made of it."""

import errno

import numpy as np
import pytest

from mapdeal import FileAccessError, OccupancyGrid
from mapdeal.files.transaction import RowsWriter, Transaction
from mapdeal.kernels.blocks import CacheBudget, LazyLayer, rows_reported
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline import inputs as memory
from mapdeal.pipeline.folder import one_pass
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings
from mapdeal.stages import esdf as esdf_module
from mapdeal.stages import exponential_cost as exponential
from pipeline.reported import write_cells

WHOLE = np.random.default_rng(5).integers(-1, 101, (23, 4)).astype(np.int8)


def lazy_grid(asked):
    def make(rows):
        asked.append((rows.start, rows.stop))
        return WHOLE[rows]

    return OccupancyGrid(LazyLayer(WHOLE.shape, np.int8, make, block_height=5, keep=1), 0.1)


def by_rows(grid):
    """A writer whose file is the rows, and END."""
    return RowsWriter(grid.layer, lambda file: (
        lambda rows: file.write(grid.layer[rows].tobytes()), lambda: file.write(b"END"),
    ))  # fmt: skip


def asking(grid, count):
    """A writer that goes through some rows itself, and twice through the first of them."""
    return lambda file: [
        file.write(grid.layer[first : min(first + 5, 23)].tobytes())
        for first in (0, *range(0, count, 5))
    ]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [0, 10, 23])
def test_all_files_are_whole_and_each_row_is_made_once(tmp_path, threads, count):
    asked, told = [], []
    paths = [tmp_path / name for name in "abc"]
    grid = lazy_grid(asked)
    with (
        use_threads(threads),
        rows_reported(lambda rows, height: told.append((rows, height))),
        Transaction(paths) as transaction,
        one_pass(transaction, grid) as given,
    ):
        transaction.write(paths[0], by_rows(grid))
        transaction.write(paths[1], asking(given, count))
        transaction.write(paths[2], by_rows(grid))
    whole = WHOLE.tobytes() + b"END"
    again = WHOLE[:5].tobytes() + WHOLE[:count].tobytes()
    assert [path.read_bytes() for path in paths] == [whole, again, whole]
    in_order = [(0, 5), (5, 10), (10, 15), (15, 20), (20, 23)]
    assert [one for one in asked if one != (0, 5)] == in_order[1:]
    assert sum(rows for rows, _ in told) == 23
    assert {height for _, height in told} == {23}


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("where", ["begin", "rows", "finish", "asking"])
def test_a_full_disk_is_told_with_the_file_that_did_not_fit(tmp_path, threads, where):
    grid = lazy_grid([])
    good, bad = tmp_path / "good", tmp_path / "bad"

    def fail(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def begin(_):
        if where == "begin":
            fail()
        put = fail if where == "rows" else lambda _: None
        return put, fail if where == "finish" else lambda: None

    with (
        pytest.raises(FileAccessError, match=r"bad: cannot be written: No space left"),
        use_threads(threads),
        Transaction([good, bad]) as transaction,
        one_pass(transaction, grid) as given,
    ):
        transaction.write(good, asking(given, 23))
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
def test_layers_are_made_once_for_figures_and_once_for_all_files(
    building, tmp_path, monkeypatch, room, expected
):
    made = {"distances": 0, "costs": 0}

    def count(what, owner, name, rows_of):
        method = getattr(owner, name)

        def counted(*args, **kwargs):
            made[what] += rows_of(*args)
            return method(*args, **kwargs)

        monkeypatch.setattr(owner, name, counted)

    def in_blocks_of_40_rows(*_):
        return memory._Blocks(is_by_rows=True, block_height=40, cache=CacheBudget(room))

    count("distances", esdf_module, "signed_distance", len)
    count("costs", exponential.BaseCosts, "costs", lambda _, rows: rows.stop - rows.start)
    monkeypatch.setattr(memory, "_way_of", in_blocks_of_40_rows)
    recipe, settings = load_recipe("default"), Settings(threads=1, images=False)
    run_map(building, tmp_path / "out", recipe, settings)
    assert made == expected
