"""Compiled clearance trees are those of numpy and scipy, to the last byte."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal.kernels import scipy_twins
from mapdeal.kernels.distance import squared_distance, unreachable

pytestmark = [pytest.mark.slow, needs_compiled]


def check(squared, is_open, resolution=0.05, choice=0):
    from mapdeal.kernels import compiled

    assert compiled.fits(squared)
    both = compiled, scipy_twins
    tree, twin = (engine.clearance_tree(squared, is_open) for engine in both)
    assert_same(tree, twin)
    if not len(tree.peaks):
        return
    root = choice % len(tree.peaks)
    seen, twin = (engine.rooted(tree, root) for engine in both)
    assert_same(seen, twin)
    limits = np.concatenate([[0], np.maximum(seen.bottlenecks, 0)])
    areas = [engine.basin_areas(tree.basins, squared, 3, len(tree.peaks)) for engine in both]
    assert bits(areas[0]) == bits(areas[1])
    metres = np.empty((2, *squared.shape), np.float32)
    for engine, result in zip(both, metres, strict=True):
        engine.widest_metres(tree.basins, squared, limits, resolution, result)
    assert bits(metres[0]) == bits(metres[1])
    for engine, result in zip(both, metres, strict=True):
        engine.clearance_metres(squared, resolution, result)
    assert bits(metres[0]) == bits(metres[1])


def bits(array):
    return array.shape, array.dtype, array.tobytes()


def assert_same(one, other):
    for name in one.__dataclass_fields__:
        assert bits(getattr(one, name)) == bits(getattr(other, name)), name


@given(
    st.integers(1, 40), st.integers(1, 40), st.sampled_from([0.0, 0.02, 0.1, 0.4, 0.9]),
    st.sampled_from([1.0, 0.9, 0.5]), st.sampled_from([np.int32, np.int64]), st.integers(0, 2**32),
    st.floats(1e-3, 10),
)  # fmt: skip
def test_on_random_cells(height, width, density, known, dtype, seed, resolution):
    rng = np.random.default_rng(seed)
    occupied = rng.random((height, width)) < density
    squared = squared_distance(occupied)
    if dtype == np.int64:
        endless = squared == unreachable(squared)
        squared = np.where(endless, np.iinfo(np.int64).max, squared.astype(np.int64))
    check(squared, rng.random(occupied.shape) < known, resolution, seed)


@given(st.integers(1, 30), st.integers(1, 30), st.integers(1, 6), st.integers(0, 2**32))
def test_on_any_squares_with_many_ties(height, width, most, seed):
    rng = np.random.default_rng(seed)
    squared = rng.integers(0, most, (height, width)).astype(np.int32)
    squared[squared == 5] = unreachable(squared)
    check(squared, squared > 0, choice=seed)


@pytest.mark.parametrize("shape", [(700, 600), (30, 9000), (9000, 1)])
@pytest.mark.parametrize("density", [0.0005, 0.05])
def test_on_many_bands_of_rows(shape, density):
    occupied = np.random.default_rng(7).random(shape) < density
    squared = squared_distance(occupied)
    check(squared, ~occupied, choice=11)


def test_on_a_spiral_whose_ways_cross_all_bands_many_times():
    """Pointers lead along the corridor to its widest place, at the end."""
    spiral = np.zeros((600, 600), np.int32)
    top, bottom, left, right, step = 0, 599, 0, 599, 0
    while top <= bottom and left <= right:
        cells = [(top, x) for x in range(left, right + 1)]
        cells += [(y, right) for y in range(top + 1, bottom + 1)]
        cells += [(bottom, x) for x in range(right - 1, left - 1, -1)]
        cells += [(y, left) for y in range(bottom - 1, top + 1, -1)]
        for cell in cells:
            step += 1
            spiral[cell] = step
        if left + 1 <= right and top + 2 <= bottom:
            step += 1
            spiral[top + 2, left + 1] = step
        top, bottom, left, right = top + 2, bottom - 2, left + 2, right - 2
    check(spiral, spiral > 0)
    check(spiral[::-1].copy(), spiral[::-1] > 0)


def test_squares_that_do_not_fit_are_left_to_the_twin():
    from mapdeal.kernels import compiled

    large = np.array([[2**31 - 2, 5, 2**63 - 1]])
    assert compiled.fits(large)
    large[0, 0] += 1
    assert not compiled.fits(large)
    assert not compiled.fits(np.zeros((0, 4), np.int32))


def check_distances(marked, scale, limit, table):
    from mapdeal.kernels import compiled

    metric = {
        "scale": scale,
        "outside_shift": -0.5 * scale,
        "inside_shift": scale,
        "clip": scale * 7.3,
        "gain": 1.7,
    }
    for name, arguments in [
        ("squares", {"both_kinds": True, "limit": None}),
        ("squares", {"both_kinds": False, "limit": None}),
        ("squares", {"both_kinds": True, "limit": limit}),
        ("metres", metric),
        ("metres", metric | {"clip": math.inf, "gain": 1.0}),
        ("bytes_of_squares", {"table": table}),
    ]:
        ours = getattr(compiled, name)(marked, **arguments)
        twin = getattr(scipy_twins, name)(marked, **arguments)
        assert bits(ours) == bits(twin), name


@given(
    st.integers(1, 64), st.integers(1, 64), st.floats(0, 1), st.integers(0, 2**32),
    st.floats(1e-3, 10), st.integers(0, 5000),
)  # fmt: skip
def test_distances_on_random_cells(height, width, density, seed, scale, limit):
    rng = np.random.default_rng(seed)
    marked = rng.random((height, width)) < density
    table = rng.integers(0, 256, 2 + limit // 7, dtype=np.uint8)
    check_distances(marked, scale, limit, table)


MORE_DENSITIES = [pytest.param(d, marks=pytest.mark.thorough) for d in (0.0, 1e-6, 0.1, 0.9999)]


@pytest.mark.parametrize("density", [1e-4, 0.9, *MORE_DENSITIES])
def test_on_2000_x_500_cells(density):
    """Many bands of rows, and rows that are longer than what is tried at a time."""
    rng = np.random.default_rng(7)
    marked = rng.random((2000, 500)) < density
    marked[:500, 50:325] = density > 0.5
    check_distances(marked, 0.05, 40_000, rng.integers(0, 256, 40_002, dtype=np.uint8))
