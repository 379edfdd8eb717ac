"""Values on other lattices by hand; `tests/grid/test_resample.py` has the polygons."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import fft

import oracles
from mapdeal.kernels.lookup import Lattice, largest_under, nearest_under, sum_of_inverse_distances
from mapdeal.kernels.threads import use_threads
from strategies import masks

VALUES = np.array([[1, 0, 9], [4, 0, 0]], np.uint8)


def test_views_and_empty_arrays():
    turned = np.rot90(np.repeat(VALUES, 2, axis=0)[::2])
    assert largest_under(turned, turned.shape, Lattice(0, 0, 1.0)).tolist() == turned.tolist()
    one = largest_under(turned, (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    other = largest_under(np.ascontiguousarray(turned), (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    assert one.tolist() == other.tolist()
    for values, shape in ((np.zeros((0, 3), np.uint8), (2, 2)), (VALUES, (0, 4))):
        assert not largest_under(values, shape, Lattice(0, 0, 1.0, 0.3)).any()
        assert not nearest_under(values, shape, Lattice(0, 0, 1.0, 0.3))[1].any()


@pytest.mark.parametrize("turn", [0.0, 1e-12])
def test_a_centre_on_a_border_belongs_to_the_cell_after_it(turn):
    found, inside = nearest_under(VALUES, (1, 4), Lattice(-0.5, -0.5, 1.0, turn, 1e-9))
    assert found.tolist() == [[1, 0, 9, 0]]
    assert inside.tolist() == [[True, True, True, False]]


@settings(max_examples=60)
@given(masks(), st.sampled_from([0.05, 1.0, 0.3]))
def test_the_convolution_is_the_direct_sum(marked, scale):
    expected = oracles.sum_of_inverse_distances(marked, scale, 0.001)
    found = sum_of_inverse_distances(marked, scale=scale, least=0.001)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 400), (400, 1), (97, 211)])
@pytest.mark.parametrize("density", [0.002, 0.3])
def test_larger_maps_too(shape, density):
    marked = np.random.default_rng(7).random(shape) < density
    marked[0, 0] = True
    rows, cols = np.nonzero(marked)
    expected = np.zeros(shape)
    with np.errstate(divide="ignore"):
        for row, col in zip(rows, cols, strict=True):
            squares = np.add.outer(
                (np.arange(shape[0]) - row) ** 2, (np.arange(shape[1]) - col) ** 2
            )
            expected += np.where(squares > 0, 1 / np.sqrt(squares), 0.0)
    found = sum_of_inverse_distances(marked)
    assert np.max(np.abs(found - expected) / np.maximum(expected, 1e-3)) < 1e-9


def test_terms_at_or_below_the_least_distance_are_left_out():
    marked = np.array([[True, False, False, False]])
    found = sum_of_inverse_distances(marked, scale=0.5, least=1.0)
    assert found == pytest.approx(np.array([[0, 0, 0, 1 / 1.5]]))


def test_no_sum_is_negative_and_the_bytes_do_not_depend_on_threads():
    marked = np.zeros((300, 301), bool)
    marked[3, 4] = True
    results = []
    for threads in (1, 2, 5):
        with use_threads(threads):
            results.append(sum_of_inverse_distances(marked))
    assert results[0].min() >= 0
    assert results[0].tobytes() == results[1].tobytes() == results[2].tobytes()


def test_fewer_threads_give_the_same(monkeypatch):
    marked = np.random.default_rng(7).random((20, 31)) < 0.1
    expected = sum_of_inverse_distances(marked)
    transform = fft.dctn

    def without_threads(array, workers, **more):
        if workers > 1:
            raise RuntimeError("Resource temporarily unavailable")
        return transform(array, workers=workers, **more)

    monkeypatch.setattr(fft, "dctn", without_threads)
    with use_threads(4):
        assert (sum_of_inverse_distances(marked) == expected).all()
