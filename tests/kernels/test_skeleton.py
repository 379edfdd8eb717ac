"""Lengths of paths over cells, by a search of the tests' own, and thin lines of areas."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

import oracles
from drawn import cells
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels.skeleton import (
    DIAGONAL,
    STRAIGHT,
    far_from,
    lengths_from,
    nearest_from,
    neighbouring,
    skeleton,
)
from strategies import masks

ROOT_OF_2 = math.sqrt(2)


@given(masks(16), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_lengths_are_those_of_dijkstra(closed, count, seed):
    is_open = ~closed
    places = np.flatnonzero(is_open)
    if not len(places):
        return
    sources = np.random.default_rng(seed).choice(places, count)
    lengths, origin = nearest_from(is_open, sources)
    width = is_open.shape[1]
    expected = oracles.lengths_from(is_open, [divmod(int(index), width) for index in sources])
    for (row, col), length in np.ndenumerate(lengths):
        if (row, col) not in expected:
            assert length == origin[row, col] == -1
            continue
        # 17 / 12 is a little more than the root of 2, and other ways may be as short
        assert expected[row, col] * STRAIGHT <= length + 1e-9
        assert length <= expected[row, col] * DIAGONAL / ROOT_OF_2 + 1e-9
        alone = oracles.lengths_from(is_open, [divmod(int(sources[origin[row, col]]), width)])
        assert alone[row, col] * DIAGONAL / ROOT_OF_2 + 1e-9 >= length


@needs_compiled
@given(masks(16), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_both_engines_give_the_same_lengths_and_sources(closed, count, seed):
    rng = np.random.default_rng(seed)
    sources = rng.integers(0, closed.size, count)
    offsets = rng.integers(0, 60, count) if seed % 2 else None
    limit = int(rng.integers(0, 200)) if seed % 3 else None
    compiled, twin = by_each_engine(
        lambda: [*nearest_from(~closed, sources, start_lengths=offsets, limit=limit),
                 lengths_from(~closed, sources, start_lengths=offsets, limit=limit)]
    )  # fmt: skip
    np.testing.assert_array_equal(compiled, twin)
    np.testing.assert_array_equal(compiled[0], compiled[2])


@given(masks(14))
def test_a_skeleton_has_the_parts_and_holes_of_its_area(area):
    distance = ndimage.distance_transform_edt(np.pad(area, 1))[1:-1, 1:-1]
    levels = np.where(area, distance.astype(np.int64), -1)
    peaks = area & (distance == ndimage.maximum_filter(distance, 3))
    lines = skeleton(levels, np.zeros_like(area), peaks)
    assert not (lines & ~area).any()
    eight = np.ones((3, 3))
    for mask in (area, lines):
        labels, count = ndimage.label(mask, eight)
        holes = ndimage.label(np.pad(~mask, 1, constant_values=True))[1]
        if mask is area:
            of_area = labels, count, holes
    assert (count, holes) == of_area[1:]
    assert len(np.unique(of_area[0][lines])) == count


def test_levels_may_be_higher_than_16_bits_hold():
    levels = np.random.default_rng(1).integers(0, 5, (9, 17))
    stays = np.eye(9, 17, dtype=np.bool_)
    assert np.array_equal(skeleton(5000 * levels, stays, ~stays), skeleton(levels, stays, ~stays))


@given(masks(16), st.integers(1, 3), st.integers(12, 1500), st.integers(0, 2**32 - 1))
def test_no_cell_without_a_short_path_is_near(closed, count, limit, seed):
    places = np.random.default_rng(seed).random((count, 2)) * closed.shape
    rows, cols = np.floor(places).astype(int).T
    lengths = lengths_from(~closed, rows * closed.shape[1] + cols, limit=None)
    is_far = far_from(~closed, places, limit)
    assert not (is_far & closed).any()
    assert is_far[~closed & ((lengths < 0) | (lengths > limit))].all()


@pytest.mark.parametrize(("limit", "first"), [(180, 13), (359, 27), (360, 26), (72, 4)])
def test_far_cells_begin_three_blocks_before_the_limit(limit, first):
    is_open = np.ones((1, 60), dtype=np.bool_)
    assert np.flatnonzero(far_from(is_open, np.zeros((1, 2)), limit))[0] == first


def test_nodes_of_one_cell_or_of_touching_areas_are_neighbours():
    is_open, nodes = cells("......\n#####.\n......") == 0, np.array([12, 2, 12, 4])
    found = neighbouring(*nearest_from(is_open, nodes), nodes)
    assert [part.tolist() for part in found] == [[0, 0, 1], [2, 3, 3], [0, 82, 24]]
