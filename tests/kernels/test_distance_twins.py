"""The compiled kernels give the bytes of scipy's, whichever engine is chosen."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal.kernels import scipy_twins

pytestmark = [pytest.mark.slow, needs_compiled]


def bits(array):
    return array.shape, array.dtype, array.tobytes()


def check(marked, scale, limit, table):
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
    st.integers(1, 64),
    st.integers(1, 64),
    st.floats(0, 1),
    st.integers(0, 2**32),
    st.floats(1e-3, 10),
    st.integers(0, 5000),
)
def test_on_random_cells(height, width, density, seed, scale, limit):
    rng = np.random.default_rng(seed)
    marked = rng.random((height, width)) < density
    table = rng.integers(0, 256, 2 + limit // 7, dtype=np.uint8)
    check(marked, scale, limit, table)


MORE_DENSITIES = [pytest.param(d, marks=pytest.mark.thorough) for d in (0.0, 1e-6, 0.1, 0.9999)]


@pytest.mark.parametrize("density", [1e-4, 0.9, *MORE_DENSITIES])
def test_on_2000_x_500_cells(density):
    """Many bands of rows, and rows that are longer than what is tried at a time."""
    rng = np.random.default_rng(7)
    marked = rng.random((2000, 500)) < density
    marked[:500, 50:325] = density > 0.5
    check(marked, 0.05, 40_000, rng.integers(0, 256, 40_002, dtype=np.uint8))
