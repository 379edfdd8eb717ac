import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mapdeal.kernels.lookup import (
    bytes_of_distances,
    histogram,
    level_rows,
    look_up,
    raise_bytes,
    set_where,
    squares_of_distances,
)

pytestmark = pytest.mark.usefixtures("each_engine")

BYTE_ARRAYS = arrays.arrays(np.uint8, arrays.array_shapes(min_dims=2, max_dims=2, max_side=40))


@given(BYTE_ARRAYS, st.binary(min_size=256, max_size=256))
def test_a_value_gets_its_entry_of_the_table(values, table):
    result = look_up(values, np.frombuffer(table, dtype=np.uint8))
    assert result.tobytes() == values.tobytes().translate(table)


@given(
    BYTE_ARRAYS,
    st.lists(st.integers(1, 255), max_size=12, unique=True),
    st.binary(min_size=13, max_size=13),
)
def test_tables_of_few_runs_are_looked_up_as_others(values, starts, entries):
    edges = [0, *sorted(starts), 256]
    runs = zip(edges, edges[1:], entries, strict=False)
    table = b"".join(bytes([entry]) * (end - start) for start, end, entry in runs)
    result = look_up(values, np.frombuffer(table, dtype=np.uint8))
    assert result.tobytes() == values.tobytes().translate(table)


@given(st.data(), BYTE_ARRAYS, st.sampled_from([1, 253]))
def test_costs_are_raised_cell_by_cell(data, costs, least):
    asked = data.draw(arrays.arrays(np.uint8, costs.shape))
    costs = np.where(data.draw(arrays.arrays(np.bool_, costs.shape)), 255, costs).astype(np.uint8)
    expected = [
        (new if new >= least else 255) if old == 255 else max(old, new)
        for old, new in zip(costs.ravel().tolist(), asked.ravel().tolist(), strict=True)
    ]
    raise_bytes(costs, asked, least=least, unknown=255)
    assert costs.ravel().tolist() == expected


@given(st.data())
def test_levels_are_those_of_each_distance(data):
    shape = data.draw(arrays.array_shapes(min_dims=2, max_dims=2, max_side=40))
    distance = data.draw(arrays.arrays(np.float32, shape, elements=st.floats(-9, 9, width=32)))
    obstacles, unknown = (data.draw(arrays.arrays(np.bool_, shape)) for _ in range(2))
    distance[0, 0] = data.draw(st.sampled_from([np.inf, -np.inf, 0.0]))
    levels, below, first = 119, data.draw(st.integers(1, 118)), data.draw(st.integers(0, 3))
    low, factor = -1.25, 37.5
    found = level_rows(
        distance, obstacles, unknown, low=low, factor=factor, levels=levels, first=first,
        below=below, faded_by=119,
    )  # fmt: skip
    for cell in np.ndindex(shape):
        step = (distance[cell] - np.float32(low)) * np.float32(factor)
        level = int(min(max(step, 0), levels - 1)) + first
        level = min(level, below - 1) if obstacles[cell] else max(level, below)
        assert found[cell] == level + 119 * unknown[cell]


@given(BYTE_ARRAYS)
def test_a_histogram_counts_every_value(values):
    counts = histogram(values)
    cells = values.ravel().tolist()
    assert counts.tolist() == [cells.count(value) for value in range(256)]
    assert histogram(values.view(np.int8)[::-1]).tolist() == counts.tolist()


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (700, 1001)])
def test_large_and_odd_arrays_are_covered_whole(shape):
    values = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    assert np.array_equal(histogram(values), np.bincount(values.ravel(), minlength=256))
    table = np.random.default_rng(4).integers(0, 256, 256, dtype=np.uint8)
    assert np.array_equal(look_up(values, table), np.take(table, values))
    mask = values > 128
    expected = np.where(mask, 7, values)
    set_where(values, mask, 7)
    assert np.array_equal(values, expected)


METRES = st.floats(width=32, allow_nan=False) | st.integers(0, 400).map(
    lambda square: np.float32(0.05 * square**0.5)
)


@pytest.mark.slow
@given(
    arrays.arrays(np.float32, (5, 7), elements=METRES), arrays.arrays(np.bool_, (5, 7)),
    st.sampled_from([0.05, 1.0, 1e-3]), st.sampled_from([0.0, 0.025, 0.5]),
    st.sampled_from([1.0, 1.5, 0.1]), st.sampled_from([np.inf, 0.7, 3.0]), st.integers(1, 500),
)  # fmt: skip
def test_bytes_of_distances_are_those_of_their_squares(
    distance, obstacles, scale, shift, gain, clip, entries
):
    table = np.arange(entries + 1).astype(np.uint8)
    measure = {"scale": scale, "shift": shift, "gain": gain, "clip": clip}
    with np.errstate(over="ignore"):
        squares = squares_of_distances(distance, obstacles, **measure)
        result = bytes_of_distances(distance, obstacles, table, **measure)
    for cell, square in zip(result.flat, squares.flat, strict=True):
        assert cell == table[int(square) if square < entries else entries]


def test_a_distance_at_the_clip_has_the_last_entry_however_long_the_table():
    distance = np.array([[0.5, 0.375, 0.625]], dtype=np.float32)
    table = np.arange(30, dtype=np.uint8)
    found = bytes_of_distances(
        distance, np.zeros((1, 3), bool), table, scale=0.125, shift=0.0, gain=1.0, clip=0.5
    )
    assert found.tolist() == [[29, 9, 29]]
