"""Shapes of small reach around marked cells, against brute force; both engines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

import oracles
from engines import ENGINES
from mapdeal.kernels.distance import dilate_square, inflated, ringed, within_distance
from mapdeal.kernels.threads import use_threads
from strategies import masks

# Narrow, wide, higher than a band of rows, wider than a strip of cells.
SHAPES = [(1, 1), (1, 700), (150, 1), (200, 90), (70, 1100), (131, 513)]
REACHES = [0, 1, 2, 3, 4, 7, 8, 15, 16, 31, 33, 62, 63, 70]


@given(masks(), st.integers(0, 20))
def test_dilation_equals_brute_force_and_never_wraps(marked, reach):
    assert np.array_equal(dilate_square(marked, reach), oracles.square_inflation(marked, reach))


@given(masks(), st.integers(0, 300))
def test_discs_equal_brute_force(marked, square):
    expected = oracles.squared_distance(marked) <= square if marked.any() else marked
    assert np.array_equal(within_distance(marked, square), expected)


@given(masks(), st.lists(st.integers(-1, 100), min_size=1, max_size=9), st.data())
def test_rings_equal_brute_force(marked, costs, data):
    seed = data.draw(st.integers(0, 2**32 - 1))
    values = np.random.default_rng(seed).integers(-1, 101, marked.shape).astype(np.int8)
    expected = values.copy()
    for k in reversed(range(len(costs))):
        expected[oracles.square_inflation(marked, k)] = costs[k]
    assert np.array_equal(ringed(values, marked, costs), expected)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("density", [0.0, 0.001, 0.2])
def test_large_shapes_equal_those_of_scipy(monkeypatch, engine, shape, density):
    monkeypatch.setenv("MAPDEAL_KERNELS", engine)
    marked = np.random.default_rng(7).random(shape) < density
    near = ndimage.distance_transform_cdt(~np.pad(marked, 1), "chessboard")[1:-1, 1:-1]
    squares = ndimage.distance_transform_edt(~marked) ** 2 if marked.any() else np.full(shape, 1e9)
    for reach in REACHES:
        wanted = near <= reach if marked.any() else marked
        with use_threads(2):
            assert np.array_equal(dilate_square(marked, reach), wanted), reach
            for square in (reach * reach, reach * reach + reach):
                found = within_distance(marked, square)
                assert np.array_equal(found, squares <= square + 1e-6), square
    values = np.full(shape, 5, np.int8)
    costs = list(range(100, 20, -1))
    for count in (1, 4, 63, 64, 80):
        rings = np.where(near < count, np.array(costs)[np.minimum(near, 79)], 5)
        expected = rings if marked.any() else values
        assert np.array_equal(ringed(values, marked, costs[:count]), expected)


@given(masks(), st.integers(0, 90), st.booleans(), st.data())
def test_values_are_put_around_those_from_a_threshold_on(marked, square, is_disc, data):
    seed = data.draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    values = np.where(
        marked, rng.integers(60, 101, marked.shape), rng.integers(-1, 60, marked.shape)
    )
    values = values.astype(np.int8)
    kept = data.draw(st.sampled_from([None, -1, 30, 70, 101]))
    if is_disc:
        covered = oracles.squared_distance(marked) <= square if marked.any() else marked
        found = inflated(values, 60, square=square, value=99, kept=kept)
    else:
        covered = oracles.square_inflation(marked, square % 9)
        found = inflated(values, 60, reach=square % 9, value=99, kept=kept)
    expected = np.where(
        covered & ((values != (200 if kept is None else kept)) | marked), 99, values
    )
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("marked", [np.zeros((2, 2)), np.zeros(3, np.bool_)])
def test_masks_are_of_two_axes_and_bool(marked):
    with pytest.raises(ValueError, match="a mask must be a bool array with two axes"):
        dilate_square(marked, 1)


def test_masks_that_are_views_are_taken():
    marked = np.zeros((40, 60), np.bool_)
    marked[3, 4] = marked[30, 50] = True
    turned = marked.T[::2, ::-1]
    assert np.array_equal(dilate_square(turned, 3), dilate_square(turned.copy(), 3))
    values = np.arange(turned.size, dtype=np.int64).reshape(turned.shape).astype(np.int8)
    rings = ringed(values.T, turned.T, [9, 8])
    assert np.array_equal(rings, ringed(values, turned, [9, 8]).T)
