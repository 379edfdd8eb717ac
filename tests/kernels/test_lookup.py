"""Values on other lattices by hand; `tests/grid/test_resample.py` has the polygons."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as arrays
from scipy import fft

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels import lookup
from mapdeal.kernels.lookup import Lattice, largest_under
from mapdeal.kernels.threads import use_threads
from strategies import masks

BYTE_ARRAYS = arrays.arrays(np.uint8, arrays.array_shapes(min_dims=2, max_dims=2, max_side=20))


@st.composite
def tables(draw):
    """A table of any entries, or of few runs of equal ones."""
    if draw(st.booleans()):
        return draw(st.binary(min_size=256, max_size=256))
    edges = [0, *sorted(draw(st.lists(st.integers(1, 255), max_size=12, unique=True))), 256]
    entries = draw(st.binary(min_size=len(edges), max_size=len(edges)))
    return b"".join(entries[k : k + 1] * (b - a) for k, (a, b) in enumerate(pairwise(edges)))


@given(BYTE_ARRAYS, tables())
def test_a_value_gets_its_entry_of_the_table(each_engine, values, table):
    result = lookup.look_up(values, np.frombuffer(table, dtype=np.uint8))
    assert result.tobytes() == values.tobytes().translate(table)


@given(st.data(), BYTE_ARRAYS, st.sampled_from([1, 253]))
def test_costs_are_raised_cell_by_cell(each_engine, data, costs, least):
    raised = data.draw(arrays.arrays(np.uint8, costs.shape))
    costs = np.where(data.draw(arrays.arrays(np.bool_, costs.shape)), 255, costs).astype(np.uint8)
    known = np.where(raised >= least, raised, 255)
    expected = np.where(costs == 255, known, np.maximum(costs, raised))
    lookup.raise_bytes(costs, raised, least=least, unknown=255)
    assert costs.tolist() == expected.tolist()


@given(st.integers(0, 2**32 - 1), st.sampled_from([np.inf, -np.inf, 0.0]), st.integers(1, 118),
       st.integers(0, 3))  # fmt: skip
def test_levels_are_those_of_each_distance(each_engine, seed, odd, below, first):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 20, 2))
    distance = rng.uniform(-9, 9, shape).astype(np.float32)
    distance[0, 0] = odd
    obstacles, unknown = rng.random((2, *shape)) < 0.5
    found = lookup.level_rows(
        distance, obstacles, unknown, low=-1.25, factor=37.5, levels=119, first=first,
        below=below, faded_by=119,
    )  # fmt: skip
    for cell in np.ndindex(shape):
        step = (distance[cell] + np.float32(1.25)) * np.float32(37.5)
        level = int(min(max(step, 0), 118)) + first
        level = min(level, below - 1) if obstacles[cell] else max(level, below)
        assert found[cell] == level + 119 * unknown[cell]


@given(BYTE_ARRAYS)
def test_a_histogram_counts_every_value(each_engine, values):
    counts = lookup.histogram(values)
    cells = values.ravel().tolist()
    assert counts.tolist() == [cells.count(value) for value in range(256)]
    assert lookup.histogram(values.view(np.int8)[::-1]).tolist() == counts.tolist()


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (700, 1001)])
def test_large_and_odd_arrays_are_covered_whole(each_engine, shape):
    values = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    assert np.array_equal(lookup.histogram(values), np.bincount(values.ravel(), minlength=256))
    table = np.random.default_rng(4).integers(0, 256, 256, dtype=np.uint8)
    assert np.array_equal(lookup.look_up(values, table), np.take(table, values))
    mask = values > 128
    expected = np.where(mask, 7, values)
    lookup.set_where(values, mask, 7)
    assert np.array_equal(values, expected)


SQUARES = st.integers(0, 400)
METRES = st.floats(width=32, allow_nan=False) | SQUARES.map(lambda k: np.float32(0.05 * k**0.5))


@pytest.mark.slow
@given(
    arrays.arrays(np.float32, (5, 7), elements=METRES), arrays.arrays(np.bool_, (5, 7)),
    st.sampled_from([0.05, 1.0, 1e-3]), st.sampled_from([0.0, 0.025, 0.5]),
    st.sampled_from([1.0, 1.5, 0.1]), st.sampled_from([np.inf, 0.7, 3.0]), st.integers(1, 500),
)  # fmt: skip
def test_bytes_are_of_squares(each_engine, distance, obstacles, scale, shift, gain, clip, entries):
    table = np.arange(entries + 1).astype(np.uint8)
    measure = {"scale": scale, "shift": shift, "gain": gain, "clip": clip}
    with np.errstate(over="ignore"):
        squares = lookup.squares_of_distances(distance, obstacles, **measure)
        result = lookup.bytes_of_distances(distance, obstacles, table, **measure)
    for cell, square in zip(result.flat, squares.flat, strict=True):
        assert cell == table[int(square) if square < entries else entries]


def test_a_distance_at_the_clip_has_the_last_entry_however_long_the_table(each_engine):
    distance = np.array([[0.5, 0.375, 0.625]], dtype=np.float32)
    table, measure = np.arange(30, dtype=np.uint8), {"scale": 0.125, "shift": 0.0, "gain": 1.0}
    found = lookup.bytes_of_distances(distance, distance < 0, table, clip=0.5, **measure)
    assert found.tolist() == [[29, 9, 29]]


SHAPES = arrays.array_shapes(min_dims=2, max_dims=2, max_side=6)
VALUES = arrays.arrays(np.float32, SHAPES, elements=st.floats(-100, 100, width=32))
ANY_VALUES = arrays.arrays(np.float32, (3, 4), elements=st.floats(width=32, allow_nan=False))


@given(VALUES, arrays.arrays(np.float64, (7, 2), elements=st.floats(0, 1)))
def test_values_and_slopes_are_those_of_the_formula(each_engine, values, shares):
    places = shares * values.shape
    between, slopes = lookup.interpolate(values, places)
    for place, value, slope in zip(places.tolist(), between, slopes, strict=True):
        assert (value, *slope) == pytest.approx(oracles.bilinear(values, *place), abs=1e-10)


def test_near_an_infinite_value_the_nearest_cell_counts_without_a_slope(each_engine):
    values = np.array([[np.inf, 2.0, 3.0]], dtype=np.float32)
    places = np.array([[0.5, 0.9], [0.5, 1.0], [0.5, 1.1], [0.5, 2.0]])
    between, slopes = lookup.interpolate(values, places)
    assert between.tolist() == [np.inf, 2.0, 2.0, 2.5]
    assert np.isnan(slopes[:3]).all()
    assert slopes[3].tolist() == [0.0, 1.0]
    between, _ = lookup.interpolate(values.T.copy(), places[:, ::-1])
    assert between.tolist() == [np.inf, 2.0, 2.0, 2.5]


@needs_compiled
@given(ANY_VALUES, arrays.arrays(np.float64, (9, 2), elements=st.floats(-2, 6) | st.just(np.nan)))
def test_both_engines_give_the_same_bytes(values, places):
    compiled, twin = by_each_engine(lambda: lookup.interpolate(values, places))
    assert [part.tobytes() for part in compiled] == [part.tobytes() for part in twin]


def test_the_outermost_cells_go_on_for_one_cell_that_ends_there(each_engine):
    values = np.array([[1, 2, 4], [1, 3, 9]], dtype=np.float32)
    places = [(-1.0, 0.5), (3.0, 0.5), (0.5, -1.0), (0.5, 4.0), (3.0, 4.0)]
    assert lookup.interpolate(values, np.array(places))[0].tolist() == [1.0, 1.0, 1.0, 4.0, 9.0]
    beyond = [(-1.001, 0.5), (3.001, 0.5), (0.5, -1.001), (0.5, 4.001), (np.nan, 1), (1, np.inf)]
    between, slopes = lookup.interpolate(values, np.array([*beyond, (-1e300, 1), (1.0, 1.0)]))
    assert np.isnan(between[:-1]).all()
    assert np.isnan(slopes[:-1]).all()
    assert np.isfinite(between[-1])


SMALL = np.array([[1, 0, 9], [4, 0, 0]], np.uint8)


def test_views_and_empty_arrays():
    turned = np.rot90(np.repeat(SMALL, 2, axis=0)[::2])
    assert largest_under(turned, turned.shape, Lattice(0, 0, 1.0)).tolist() == turned.tolist()
    of_view = largest_under(turned, (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    of_copy = largest_under(np.ascontiguousarray(turned), (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    assert of_view.tolist() == of_copy.tolist()
    for values, shape in ((np.zeros((0, 3), np.uint8), (2, 2)), (SMALL, (0, 4))):
        assert not largest_under(values, shape, Lattice(0, 0, 1.0, 0.3)).any()
        assert not lookup.nearest_under(values, shape, Lattice(0, 0, 1.0, 0.3))[1].any()


@pytest.mark.parametrize("turn", [0.0, 1e-12])
def test_a_centre_on_a_border_belongs_to_the_cell_after_it(turn):
    found, inside = lookup.nearest_under(SMALL, (1, 4), Lattice(-0.5, -0.5, 1.0, turn, 1e-9))
    assert found.tolist() == [[1, 0, 9, 0]]
    assert inside.tolist() == [[True, True, True, False]]


@given(masks(), st.sampled_from([0.05, 1.0, 0.3]), st.sampled_from([0.001, 1.0]))
def test_the_convolution_is_the_direct_sum(marked, scale, least):
    expected = oracles.sum_of_inverse_distances(marked, scale, least)
    found = lookup.sum_of_inverse_distances(marked, scale=scale, least=least)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "density"), [((1, 400), 0.3), ((400, 1), 0.3), ((97, 99), 0.02)])
def test_larger_maps_too(shape, density):
    marked = np.random.default_rng(7).random(shape) < density
    marked[0, 0] = True
    expected = np.zeros(shape)
    for row, col in np.argwhere(marked):
        squares = np.add.outer((np.arange(shape[0]) - row) ** 2, (np.arange(shape[1]) - col) ** 2)
        squares[row, col] = -1
        expected += np.where(squares > 0, 1 / np.sqrt(np.abs(squares)), 0.0)
    found = lookup.sum_of_inverse_distances(marked)
    assert np.max(np.abs(found - expected) / np.maximum(expected, 1e-3)) < 1e-9


def test_no_sum_is_negative_and_the_bytes_do_not_depend_on_threads(monkeypatch):
    marked = np.zeros((300, 301), bool)
    marked[3, 4] = True
    results = []
    for threads in (1, 2, 5):
        with use_threads(threads):
            results.append(lookup.sum_of_inverse_distances(marked))
    transform = fft.dctn

    def without_threads(array, workers, **more):
        if workers > 1:
            raise RuntimeError("Resource temporarily unavailable")
        return transform(array, workers=workers, **more)

    monkeypatch.setattr(fft, "dctn", without_threads)
    with use_threads(4):
        results.append(lookup.sum_of_inverse_distances(marked))
    assert results[0].min() >= 0
    assert all(each.tobytes() == results[0].tobytes() for each in results)


@given(masks(9), st.integers(0, 2**32 - 1), st.sampled_from([np.int32, np.int64]))
def test_lines_have_the_least_of_their_cells_and_the_closed(each_engine, closed, seed, dtype):
    rng = np.random.default_rng(seed)
    values = rng.integers(-1, 50, closed.shape).astype(dtype)
    size = np.array(closed.shape)
    count, near = 12, 0.01
    halves = rng.integers(0, 2 * size + 1, (2, count, 2)) / 2  # many lie on edges of cells
    starts, ends = np.minimum(halves + rng.choice([0, 0.3], (2, count, 2)), size - 1e-6)
    counts = rng.choice([1, 2, 3, 29], count)  # short lines are open more often
    least, is_open = lookup.least_along(values, ~closed, starts, ends, counts, near=near)
    for line in range(count):
        found, free = [], []
        for place in range(counts[line]):
            share = place / max(counts[line] - 1, 1)
            row, col = (starts[line] + share * (ends[line] - starts[line])).tolist()
            found.append(values[int(row), int(col)])
            around = np.add([row, col], np.indices((3, 3)).reshape(2, 9).T * near - near)
            cells = np.clip(around, 0, size - 1).astype(int)
            free += (~closed[tuple(cells.T)]).tolist()
        assert least[line] == min(found)
        assert is_open[line] == all(free)
