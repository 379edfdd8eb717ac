import itertools
import tracemalloc
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from mapdeal.kernels import components
from mapdeal.kernels.components import Components, drop_small_groups, gap_at, labelled, thickness_of
from mapdeal.kernels.distance import squared_distance
from strategies import masks

HEIGHTS = st.lists(st.integers(1, 5), min_size=1, max_size=3)


def added(rows, heights, **options):
    found, first, turns = Components(**options), 0, itertools.cycle(heights)
    while first < len(rows):
        height = next(turns)
        found.add(rows[first : first + height])
        first += height
    return found


def middle_by_hand(group, width):
    """The middle of the longest row of cells of a component, as a number; the lowest of several."""
    runs = []
    for row, col in sorted(group):
        if not runs or (row, col - 1) != runs[-1][-1]:
            runs.append([])
        runs[-1].append((row, col))
    longest = max(map(len, runs))
    middles = [run[(longest - 1) // 2] for run in runs if len(run) == longest]
    return min(row * width + col for row, col in middles)


@given(masks(20), HEIGHTS, st.booleans(), st.integers(1, 40))
def test_sizes_and_middles_of_runs_are_those_of_flooding(marked, heights, from_last, together):
    middles = defaultdict(list)
    for group in oracles.groups(marked):
        middles[len(group)].append(middle_by_hand(group, marked.shape[1]))
    last_row = len(marked) - 1 if from_last else None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(components, "_CELLS_TOGETHER", together)
        found = added(marked[::-1] if from_last else marked, heights, last_row=last_row)
        sizes, counts = found.sizes()
    assert sizes.tolist() == sorted(middles)
    assert counts.tolist() == [len(middles[size]) for size in sorted(middles)]
    places = {size: sorted(middles[size])[: components.MOST_PLACES] for size in sorted(middles)}
    assert list(found.places().items()) == list(places.items())


def test_memory_does_not_grow_with_the_rows():
    """Lone cells, as many as there can be: each is a component of its own."""
    band = np.zeros((64, 512), bool)
    band[::2, ::2] = True
    found = Components()
    found.add(band)
    tracemalloc.start()
    for _ in range(50):
        found.add(band)
    used, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    sizes, counts = found.sizes()
    assert (sizes.tolist(), counts.tolist()) == ([1], [51 * 32 * 256])
    assert used < 100_000
    assert peak < 4_000_000


@given(masks(), masks(), st.booleans(), st.sampled_from([1, 13, 1 << 20]))
def test_components_are_those_of_a_flood(marked, neighbours, corners, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(components, "_CELLS_TOGETHER", together)  # counted in bands of rows
        found = labelled(marked, corners=corners)
        cells = found.cells_of(np.arange(len(found.sizes)) % 2 == 1)
    expected = oracles.groups(marked, oracles.AROUND if corners else oracles.EDGES)
    labels = range(len(found.sizes))
    groups = [frozenset(map(tuple, np.argwhere(found.cells == k).tolist())) for k in labels]
    assert set(groups[1:]) == set(map(frozenset, expected))
    assert found.sizes.tolist() == [0, *map(len, groups[1:])]
    assert np.array_equal(cells, found.cells % 2 == 1)
    touching = np.resize(neighbours, marked.shape)
    touched = [k for k in labels[1:] if any(touching[cell] for cell in groups[k])]
    assert np.flatnonzero(found.touched_by(touching)).tolist() == touched


@given(masks(), st.integers(0, 6))
def test_small_groups_are_dropped_whole(marked, least):
    expected = np.zeros_like(marked)
    for group in oracles.groups(marked):
        for cell in group if len(group) >= least else ():
            expected[cell] = True
    assert np.array_equal(drop_small_groups(marked, least), expected)


@given(masks())
def test_thickness_is_that_of_walking_along_row_and_column(marked):
    expected = oracles.thickness(marked)
    assert thickness_of(marked).tolist() == [expected[cell] for cell in sorted(expected)]


def bar_at(occupied, cell, squared=None):
    squared = squared_distance(occupied) if squared is None else squared
    return gap_at(squared, np.where(occupied, -1, 0).astype(np.int32), cell)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("gap", "thickness"), [(1, 1), (1, 7), (2, 2), (3, 1), (3, 3), (8, 7)])
def test_the_bar_lies_across_the_middle_of_the_door(gap, thickness, turned):
    occupied = np.pad(np.zeros((29, 38), dtype=bool), 1, constant_values=True)
    door = np.s_[9 : 9 + gap, 12 : 12 + thickness]
    occupied[:, door[1]] = True
    occupied[door] = False
    squared = squared_distance(occupied)
    saddles = np.argwhere(squared[door] == squared[door].max()) + np.array([9, 12])
    assert len(saddles) >= thickness
    for row, col in saddles.tolist():  # any of them may be the saddle
        ends = bar_at(occupied.T.copy(), (col, row)) if turned else bar_at(occupied, (row, col))
        (low, column), (high, end_column) = (end[::-1] if turned else end for end in ends)
        assert (low, high) == (8, 9 + gap)
        assert column == end_column
        assert abs(column - (12 + (thickness - 1) / 2)) <= 0.5


def test_the_ridge_does_not_run_along_the_walls_of_rooms():
    # The saddle is as far from the wall as are the cells along it.
    occupied = np.zeros((30, 40), dtype=bool)
    occupied[0] = occupied[4, 6] = True
    assert bar_at(occupied, (2, 6)) == ((0.0, 6.0), (4.0, 6.0))


def test_a_diagonal_gap_is_crossed_from_corner_to_corner():
    occupied = np.eye(20, dtype=bool) | np.eye(20, k=1, dtype=bool)
    occupied[8:11] = False
    squared = squared_distance(occupied)
    along = [(k, k + i) for i in (0, 1) for k in range(7, 12)]
    first, second = bar_at(occupied, max(along, key=lambda cell: squared[cell]))
    assert first in {(7.0, 7.0), (7.0, 8.0)}
    assert second in {(11.0, 11.0), (11.0, 12.0)}


def test_bars_end_with_open_cells_and_the_map():
    occupied = np.zeros((12, 20), dtype=bool)
    occupied[2] = True
    basins = np.where(occupied, -1, 0).astype(np.int32)
    basins[6:, 9:12] = -1  # unknown
    assert gap_at(squared_distance(occupied), basins, (5, 10)) == ((2.0, 10.0), (6.0, 10.0))
    squared = squared_distance(np.pad(occupied, 1, constant_values=True))[1:-1, 1:-1]
    assert bar_at(occupied, (7, 8), squared) == ((2.0, 9.0), (12.0, 9.0))
    alone = np.ones((1, 1), dtype=np.int32)
    assert bar_at(alone == 0, (0, 0), alone) == ((-1.0, 0.0), (1.0, 0.0))


def test_the_bar_lies_in_the_middle_of_a_long_door():
    occupied = np.ones((9, 300), dtype=bool)
    occupied[1:8, 1:20] = occupied[1:8, 280:299] = occupied[3:6, 20:280] = False
    for col in (25, 140, 275):
        (low, column), (high, end_column) = bar_at(occupied, (4, col))
        assert (low, high) == (2, 6)
        assert column == end_column == pytest.approx(149.5, abs=1)


def test_each_door_between_two_regions_has_its_widest_cell():
    occupied = np.pad(np.zeros((7, 7), dtype=bool), 1, constant_values=True)
    occupied[[1, 3, 4], 4] = True  # doors of one row and of three
    basins = np.where(occupied, -1, np.arange(9) > 4).astype(np.int32)
    found = components.saddles_between(squared_distance(occupied), basins, np.array([5, 3]))
    assert found.tolist() == [[6 * 9 + 4, 3, 5], [2 * 9 + 4, 3, 5]]
