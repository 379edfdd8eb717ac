"""How much memory a map gets, and how it is cut into blocks, by numbers computed by hand."""

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from mapdeal import MalformedInputError
from mapdeal.files import source as budget_of_readers
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline import inputs as memory
from mapdeal.pipeline.settings import Settings

DEMAND = memory._Demand(base=1000, per_cell=3.0, per_block_cell=40)


@pytest.fixture(autouse=True)
def _one_demand(monkeypatch):
    monkeypatch.setattr(memory, "_DEMANDS", dict.fromkeys(("compiled", "scipy"), DEMAND))


class Step:
    memory = 1.5
    parameters = None
    stage = SimpleNamespace(of_library=0, is_whole=lambda _: False)


def cut(available, *, base=500, threads=1, shape=(3000, 1000), steps=(Step,)):
    with use_threads(threads):
        return memory._block_plan(Path("m.pgm"), shape, steps, base + available, base, needed=10**9)


@pytest.mark.parametrize(("available", "threads", "rows", "unused"), [
    # 40 bytes for a cell, in one thread and once more: 80 000 a row, of half the memory;
    # 20 bytes for each of 1000 columns of each block
    (80_000_000, 1, 500, 80_000_000 - 500 * 80_000 - 6 * 20_000),
    (80_000_000, 3, 250, 80_000_000 - 250 * 160_000 - 12 * 20_000),
    (10**9, 1, 3000, 10**9 - 3000 * 80_000 - 20_000),
    # what blocks keep of their columns would fit a quarter of the memory from 25 rows on
    (2_400_000 * 4, 1, 60, 9_600_000 - 60 * 80_000 - 50 * 20_000),
])  # fmt: skip
def test_half_of_the_memory_is_for_blocks(available, threads, rows, unused):
    found, budget = cut(available, threads=threads)
    assert (found, budget._available) == (rows, unused)


def test_blocks_are_no_larger_than_is_of_use():
    assert cut(10**12, shape=(100_000, 1000))[0] == (1 << 22) // 1000
    # the longest run that a block's edge can hold
    assert cut(10**12, shape=(100_000, 10))[0] == (1 << 16) - 1


def test_too_little_memory_says_how_much_would_do():
    with pytest.raises(MalformedInputError, match="1000 x 3000 cells need") as caught:
        cut(1_000_000)
    needed = float(str(caught.value).split("need ")[1].split(" MB")[0]) * 1e6
    cut(needed)
    with pytest.raises(MalformedInputError):
        cut(0.9 * needed)

    class InMemory(Step):
        stage = SimpleNamespace(of_library=0, is_whole=lambda _: True)

    with pytest.raises(MalformedInputError, match="need 1 GB of memory, 80 MB may be used"):
        cut(80_000_000, base=0, steps=(Step, InMemory))


def test_the_memory_of_a_map_includes_its_steps_and_pictures():
    # 1000 of the engine; 3 of the engine, 1 of the map and 1.5 of the step for each of 12 cells
    drawing = 11_000_000
    assert memory.bytes_in_memory((3, 4), [Step], None) == 1000 + 66
    assert memory.bytes_in_memory((3, 4), [Step, Step], 0) == 1084 + drawing + 10 * 12
    assert memory.bytes_in_memory((3, 4), [Step], 2) == 1066 + drawing + 10 * 2 * 2
    assert memory.bytes_in_memory((30, 4), [], 20) == 1480 + drawing + 10 * 15 * 2
    # 16 bytes for each line beyond a few thousand, and 130 where distances are measured
    lines = 30_001 - budget_of_readers._FEW_LINES
    for steps, of_cells, of_line in (([], 4, 16), ([Step], 5.5, 146)):
        expected = 1000 + int(of_cells * 30_000) + of_line * lines
        assert memory.bytes_in_memory((30_000, 1), steps, None) == expected


@pytest.mark.parametrize(("chosen", "free", "jobs", "budget"), [
    (7, 10**9, 1, 7), (None, None, 1, 1 << 62), (None, 10**9, 1, 5 * 10**8),
    (None, 3 * 10**8, 1, 256 * 10**6), (None, 2 * 10**8, 1, 2 * 10**8),
    (None, 10**8, 1, 128 * 10**6), (None, 2 * 10**9, 4, 25 * 10**7), (None, 10**9, 4, 128 * 10**6),
])  # fmt: skip
def test_the_budget_is_half_of_what_is_free_shared_by_jobs(monkeypatch, chosen, free, jobs, budget):
    monkeypatch.setattr(budget_of_readers, "free_memory", lambda: free)
    assert memory.memory_budget(chosen, jobs) == budget


class File:
    """A map of which the headers are known."""

    path = Path("m.pgm")

    def __init__(self, reading=0, *, by_rows=True):
        self.reading = reading
        self.shape_by_rows = (1, 1) if by_rows else None

    def memory_to_read(self):
        return self.reading


SHAPE = (4000, 4000)
CELLS = 16_000_000
WORK = 1000 + int(5.5 * CELLS)
"""What the engine and the step take."""


@pytest.mark.parametrize(("most", "shape", "reading", "by_rows", "expected"), [
    # a map that just fits is not cut; small ones are not either way
    (1066, (3, 4), 0, True, (1066, False)),
    (WORK, SHAPE, 0, True, (WORK, False)),
    (WORK - 1, SHAPE, 0, True, (WORK - 1, True)),
    # what reading takes is over when the steps begin
    (10**9, SHAPE, 5, True, (WORK, False)),
    (10**9, SHAPE, 6, True, (1000 + 6 * CELLS, False)),
    # an image that must be whole is read within the memory
    (WORK, SHAPE, 5, False, (WORK, False)),
    (WORK - 1, SHAPE, 5, False, (WORK - 1, True)),
    (1000 + 5 * CELLS, SHAPE, 5, False, (1000 + 5 * CELLS, True)),
    (5 * CELLS, SHAPE, 5, False, r"need 80\.1 MB of memory, 80 MB may be used"),
])  # fmt: skip
def test_what_a_map_needs(most, shape, reading, by_rows, expected):
    file = File(reading * CELLS, by_rows=by_rows)
    settings = Settings(max_memory=most, threads=1, images=False)
    need = partial(memory.need_of, file, shape, [Step], settings)
    if isinstance(expected, str):
        with pytest.raises(MalformedInputError, match=expected):
            need()
    else:
        assert (need().needed, need().blocks is not None) == expected
