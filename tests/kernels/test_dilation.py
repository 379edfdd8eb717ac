"""Shapes of small reach around marked cells, against brute force; both engines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from engines import ENGINES
from mapdeal.kernels.distance import dilate_square, ringed, unreachable, within_distance
from mapdeal.kernels.threads import use_threads
from mapdeal.stages.layered_cost import queue_squares
from strategies import masks

# Narrow, wide, higher than a band of rows, wider than a strip of cells.
SHAPES = [(1, 1), (1, 700), (150, 1), (200, 90), (70, 1100), (131, 513)]
REACHES = [0, 1, 2, 3, 4, 7, 8, 15, 16, 31, 33, 62, 63, 70]


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


def queue_of_costmap_2d(seeds, reach):
    """updateCosts of ROS 1's inflation_layer.cpp, cell by cell; None where it does not come."""
    height, width = seeds.shape
    bins = {0: [(my, mx, my, mx) for my, mx in np.argwhere(seeds).tolist()]}
    found = np.full(seeds.shape, None)
    level = 0
    while level <= reach * reach:
        entries = bins.get(level, [])
        index = 0
        while index < len(entries):  # it may grow
            my, mx, sy, sx = entries[index]
            index += 1
            if found[my, mx] is not None:
                continue
            found[my, mx] = level
            for ny, nx in ((my, mx - 1), (my - 1, mx), (my, mx + 1), (my + 1, mx)):
                if 0 <= ny < height and 0 <= nx < width and found[ny, nx] is None:
                    square = (ny - sy) ** 2 + (nx - sx) ** 2
                    if square <= reach * reach:
                        bins.setdefault(square, []).append((ny, nx, sy, sx))
        level += 1
    return found


@settings(max_examples=200)
@given(masks(longest=20), st.integers(0, 9))
def test_the_queue_equals_its_original_cell_by_cell(seeds, reach):
    made = queue_squares(seeds, reach)
    expected = queue_of_costmap_2d(seeds, reach)
    never = unreachable(made)
    assert made.tolist() == [[never if one is None else one for one in row] for row in expected]
