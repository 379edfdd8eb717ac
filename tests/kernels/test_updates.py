"""Rays that clear cells and voxels, and the queue of the older inflation layer."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, strategies as st

from engines import ENGINES
from mapdeal.kernels import engine
from mapdeal.kernels.distance import queued_squares
from mapdeal.kernels.sensing import CellRays, clear_cells, clear_voxels


def cells_of(start, delta, steps):
    """Walk as bresenham3D does, with an error for each axis."""
    cell, longest = list(start), max(map(abs, delta))
    errors = [longest // 2] * len(cell)
    yield tuple(cell)
    for _ in range(steps):
        for axis, length in enumerate(delta):
            errors[axis] += abs(length)
            if errors[axis] >= longest:
                errors[axis] -= longest
                cell[axis] += 1 if length > 0 else -1
        yield tuple(cell)


@pytest.fixture(params=ENGINES)
def on_engine(request, monkeypatch):
    monkeypatch.setenv(engine.VARIABLE, request.param)


PLACES = st.tuples(st.integers(0, 8), st.integers(0, 5), st.integers(0, 15))


@pytest.mark.usefixtures("on_engine")
@pytest.mark.parametrize("axes", [2, 3])
def test_rays_clear_the_cells_of_bresenhams_line(axes):
    @given(st.lists(st.tuples(PLACES, PLACES, st.floats(0, 1)), max_size=4), st.randoms())
    def check(ends, random):
        rays, expected = [], np.full((6, 9), 7, dtype=np.uint8)
        columns = np.array([[random.getrandbits(32) for _ in range(9)] for _ in range(6)], "u4")
        cleared = columns.copy()
        for start, end, share in ends:
            delta = [b - a for a, b in zip(start[:axes], end[:axes], strict=True)]
            steps = int(share * max(map(abs, delta)))
            rays.append((start[:axes], delta, steps))
            for col, row, *level in cells_of(start[:axes], delta, steps):
                if axes == 2:
                    expected[row, col] = 0
                    continue
                cleared[row, col] &= ~np.uint32(0x10001 << level[0])
                marked, both = int(cleared[row, col]) >> 16, int(cleared[row, col]) & 0xFFFF
                if marked.bit_count() <= 5:
                    expected[row, col] = 0 if (marked ^ both).bit_count() <= 6 else 255
        parts = zip(*rays, strict=True) if rays else ([], [], [])
        starts, deltas, steps = (np.array(part, dtype=np.int64) for part in parts)
        shaped = CellRays(starts.reshape(-1, axes).T, deltas.reshape(-1, axes).T, steps)
        costs = np.full((6, 9), 7, dtype=np.uint8)
        if axes == 2:
            clear_cells(shaped, costs)
        else:
            clear_voxels(shaped, costs, columns, mark_threshold=5, unknown_threshold=6)
            np.testing.assert_array_equal(columns, cleared)
        np.testing.assert_array_equal(costs, expected)

    check()


def queue_oracle(seeds, reach):
    """Run the queue of ``inflation_layer.cpp`` of ROS 1, cell by cell."""
    height, width = seeds.shape
    found, bins = {}, defaultdict(list)
    bins[0] = [(cell, cell) for cell in map(tuple, np.argwhere(seeds).tolist())]
    for square in range(reach * reach + 1):
        for (row, col), seed in bins[square]:
            if (row, col) in found:
                continue
            found[row, col] = square
            for cell in ((row, col - 1), (row - 1, col), (row, col + 1), (row + 1, col)):
                away = (cell[0] - seed[0]) ** 2 + (cell[1] - seed[1]) ** 2
                is_inside = 0 <= cell[0] < height and 0 <= cell[1] < width
                if is_inside and cell not in found and away <= reach * reach:
                    bins[away].append((cell, seed))
    squares = np.full(seeds.shape, reach * reach + 1)
    for cell, square in found.items():
        squares[cell] = square
    return squares


@pytest.mark.usefixtures("on_engine")
def test_the_queue_passes_on_seeds_as_ros_1_does():
    random, differs = np.random.default_rng(1), 0
    for reach in (1, 2, 5, 20, 20, 30, 30, 30):
        seeds = random.random((41, 50)) < 0.02 * random.random()
        squares = queued_squares(seeds, reach)
        np.testing.assert_array_equal(squares, queue_oracle(seeds, reach))
        rows, cols = np.argwhere(seeds).T
        away = (np.arange(41)[:, None, None] - rows) ** 2 + (np.arange(50)[:, None] - cols) ** 2
        nearest = np.minimum(away.min(axis=2), reach * reach + 1)
        assert (squares >= nearest).all()
        differs += (squares != nearest).sum()
    assert differs  # or the distance transform would do
