"""Rays, and those that clear cells and voxels; the queue of the older inflation layer."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, strategies as st

from engines import ENGINES, needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels import engine, sensing
from mapdeal.kernels.distance import queued_squares
from mapdeal.kernels.sensing import CellRays, Odds, cast_rays, count_rays, measure_rays, weigh_rays
from oracles import beam_lengths

FAR = st.tuples(st.integers(-9, 20) | st.integers(-(2**30), 2**30), st.integers(-9, 20))


RAYS = st.lists(st.tuples(FAR, FAR, st.booleans()), min_size=1, max_size=25)


@needs_compiled
@given(st.tuples(st.integers(1, 11), st.integers(1, 13)), RAYS)
def test_rays_from_and_to_far_away_take_no_longer(shape, rays):
    """Lines of 2^31 cells are clipped before they are walked, on both engines alike."""
    starts, ends, is_hit = (np.array(some) for some in zip(*rays, strict=True))

    def counts():
        hits, misses = np.zeros((2, *shape), dtype=np.int32)
        count_rays(starts, ends, is_hit, hits, misses)
        return hits.tolist(), misses.tolist()

    compiled, twin = by_each_engine(counts)
    assert compiled == twin


def thoroughly(number):
    return pytest.param(number, marks=pytest.mark.thorough)


@pytest.mark.slow
@pytest.mark.usefixtures("each_engine")
@pytest.mark.parametrize("length", [thoroughly(65_534), 65_535, 65_536, 131_071])
@pytest.mark.parametrize("minor", [7, 65_534, *map(thoroughly, (0, 1, 21_845, 32_767))])
@pytest.mark.parametrize("is_upright", [False, True])
def test_long_lines_move_where_their_equation_says(length, minor, is_upright):
    shape = (16, length)  # which holds the beginning of the line, or its end
    step = np.arange(length)
    for low in {0, max(0, minor - 15)}:
        moves = (length // 2 + step * minor) // length - low
        is_within = (moves >= 0) & (moves < 16)
        expected = np.zeros(shape, dtype=np.int32)
        expected[moves[is_within], step[is_within]] = 1
        start, end = (-low, 0), (minor - low, length)
        if is_upright:
            start, end, expected = start[::-1], end[::-1], expected.T
        hits, misses = np.zeros((2, *expected.shape), dtype=np.int32)
        count_rays(np.array([start]), np.array([end]), np.array([True]), hits, misses)
        np.testing.assert_array_equal(misses, expected)


@pytest.mark.thorough
@needs_compiled
def test_many_rays_give_the_same_bytes_on_both_engines_and_any_threads():
    rng = np.random.default_rng(4)
    count, shape = 60_000, (300, 260)
    starts = rng.integers(-20, 320, (count, 2))
    ends = starts + rng.integers(-150, 150, (count, 2))
    is_hit = rng.random(count) < 0.7
    sensors, ranges = starts + rng.random((count, 2)), np.abs(rng.normal(0, 90, count))

    def layers():
        hits, misses, values, weights = np.zeros((4, *shape), dtype=np.int32)
        touched, sums = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.int64)
        count_rays(starts, ends, is_hit, hits, misses)
        weigh_rays(starts, ends, is_hit, Odds(-1, 2, -40, 50), values, touched)
        measure_rays(starts, ends, sensors, ranges, 2.5, 1.7, sums, weights)
        assert misses.sum() > sensing._CELLS_TOGETHER
        return [layer.tobytes() for layer in (hits, misses, values, touched, sums, weights)]

    first, *repeated = by_each_engine(layers, threads=(1, 3))
    assert repeated == [first, first]


@pytest.mark.usefixtures("each_engine")
@pytest.mark.parametrize(("behind", "behind_cells"), [(0.5, 1), (1.0, 2), (2.0, 4)])
def test_cells_so_many_truncations_behind_the_surface_are_measured(behind, behind_cells):
    sums, weights = np.zeros((1, 10), np.int64), np.zeros((1, 10), np.int32)
    # from the centre of cell 0 to a surface 3 cells on; a truncation of 2 cells
    measure_rays(
        np.array([[0, 0]]), np.array([[0, 9]]), np.array([[0.5, 0.5]]), np.array([3.0]),
        2.0, behind, sums, weights,
    )  # fmt: skip
    measured = [1, 1, 0.5, 0, -0.5, -1, -1, -1][: 4 + behind_cells]
    assert (sums[0] / sensing.DISTANCE_UNIT).tolist() == measured + [0] * (6 - behind_cells)
    assert weights[0].tolist() == [1] * (4 + behind_cells) + [0] * (6 - behind_cells)


def cast(values, starts, angles, limit):
    return cast_rays(sensing.room_around(values > 0, values < 0), starts, angles, limit)


@given(st.integers(0, 2**32), st.integers(1, 40), st.integers(1, 50), st.floats(1, 60))
def test_beams_end_at_the_first_closed_cell(seed, height, width, limit):
    rng = np.random.default_rng(seed)
    values = rng.choice([0, 100, -1], (height, width), p=[0.96, 0.03, 0.01])
    starts = rng.random((3, 2)) * values.shape
    angles = rng.uniform(-4, 4, (3, 7))
    expected = beam_lengths(values, starts, angles, limit)
    compiled, twin = by_each_engine(lambda: cast(values, starts, angles, limit))
    np.testing.assert_allclose(compiled, expected, rtol=0, atol=1e-9)
    assert compiled.tobytes() == twin.tobytes()


@pytest.mark.usefixtures("each_engine")
def test_beams_along_edges_of_cells_belong_to_the_cells_above():
    values = np.zeros((5, 6), dtype=np.int8)
    values[2, 5] = values[4, 1] = 100
    angles = np.array([[0.0, np.pi / 2, np.pi, -np.pi / 2]])
    lengths = cast(values, np.array([[2.0, 1.0]]), angles, 9.0)
    assert lengths.tolist() == [[4.0, 2.0, np.inf, np.inf]]
    assert np.isinf(cast(values, np.array([[2.5, 9.0]]), angles, 9.0)).all()  # begin outside


@needs_compiled
def test_beams_along_edges_come_to_an_end():
    """Rounding may put them into the cell before the edge again and again."""
    values = np.zeros((90, 90), dtype=np.int8)
    values[[30, 31, 60], [10, 70, 44]] = 100
    starts = np.argwhere(values == 0)[::7].astype(np.float64)
    angles = np.tile([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi], (len(starts), 1))
    compiled, twin = by_each_engine(lambda: cast(values, starts, angles, 99.0))
    assert compiled.tobytes() == twin.tobytes()


@needs_compiled
def test_ten_thousand_beams_through_a_large_map_are_exact():
    rng = np.random.default_rng(8)
    values = np.where(rng.random((420, 390)) < 0.006, 100, 0)
    starts, angles = rng.random((10_000, 2)) * values.shape, rng.uniform(-4, 4, (10_000, 1))
    expected = beam_lengths(values, starts, angles, 300.0)
    lengths = cast(values, starts, angles, 300.0)
    assert np.isfinite(lengths).mean() > 0.5
    np.testing.assert_allclose(lengths, expected, rtol=0, atol=1e-9)


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
            sensing.clear_rays(shaped, costs)
        else:
            sensing.clear_rays(shaped, costs, columns, mark_threshold=5, unknown_threshold=6)
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
