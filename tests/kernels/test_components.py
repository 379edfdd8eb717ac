import tracemalloc
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal.kernels import components
from mapdeal.kernels.components import Components, drop_small_groups, gap_at, labelled, thickness_of
from mapdeal.kernels.distance import squared_distance
from strategies import masks


def measured(marked, heights):
    """Sizes of all components, one after the other, given rows of these heights in turn."""
    found, first, turn = Components(), 0, 0
    while first < len(marked):
        stop = first + heights[turn % len(heights)]
        found.add(marked[first:stop])
        first, turn = stop, turn + 1
    sizes, counts = found.sizes()
    return Counter(dict(zip(sizes.tolist(), counts.tolist(), strict=True)))


@given(masks(), st.lists(st.integers(1, 5), min_size=1, max_size=3), st.integers(1, 40))
def test_sizes_are_those_of_flooding_however_rows_come(marked, heights, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(components, "_CELLS_TOGETHER", together)
        found = measured(marked, heights)
    assert found == Counter(len(group) for group in oracles.groups(marked))


def middle_by_hand(group, width):
    """The middle of the longest row of cells of a component, as a number; the lowest of several."""
    runs = []
    for row, col in sorted(group):
        if runs and (row, col - 1) == runs[-1][-1]:
            runs[-1].append((row, col))
        else:
            runs.append([(row, col)])
    longest = max(map(len, runs))
    return min(
        row * width + col
        for row, col in (run[(longest - 1) // 2] for run in runs if len(run) == longest)
    )


@given(masks(20), st.lists(st.integers(1, 5), min_size=1, max_size=3), st.booleans())
def test_places_are_the_middles_of_the_longest_runs(marked, heights, from_last):
    expected = {}
    for group in oracles.groups(marked):
        middle = middle_by_hand(group, marked.shape[1])
        expected.setdefault(len(group), []).append(middle)
    found = Components(last_row=len(marked) - 1 if from_last else None)
    rows = marked[::-1] if from_last else marked
    first, turn = 0, 0
    while first < len(rows):
        height = heights[turn % len(heights)]
        found.add(rows[first : first + height])
        first, turn = first + height, turn + 1
    with_most = {
        size: sorted(listed)[: components.MOST_PLACES] for size, listed in expected.items()
    }
    assert found.places() == with_most
    assert list(found.places()) == sorted(with_most)


def test_memory_does_not_grow_with_the_rows():
    """Lone cells, as many as there can be: each is a component of its own."""
    band = np.zeros((64, 512), bool)
    band[::2, ::2] = True
    found = Components()
    found.add(band)
    tracemalloc.start()
    for _ in range(50):
        found.add(band)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    sizes, counts = found.sizes()
    assert (sizes.tolist(), counts.tolist()) == ([1], [51 * 32 * 256])
    assert held < 100_000
    assert peak < 4_000_000


@given(masks(), masks(), st.booleans(), st.sampled_from([1, 13, 1 << 20]))
def test_components_are_those_of_a_flood(marked, others, corners, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(components, "_CELLS_TOGETHER", together)  # counted in bands of rows
        found = labelled(marked, corners=corners)
        chosen = np.arange(len(found.sizes)) % 2 == 1
        cells = found.cells_of(chosen)
    expected = set(
        map(frozenset, oracles.groups(marked, oracles.AROUND if corners else oracles.EDGES))
    )
    groups = {
        frozenset(map(tuple, np.argwhere(found.cells == label).tolist())): label
        for label in range(1, len(found.sizes))
    }
    assert set(groups) == expected
    assert found.sizes[0] == 0
    assert all(found.sizes[label] == len(group) for group, label in groups.items())
    assert np.array_equal(cells, found.cells % 2 == 1)
    touching = np.resize(others, marked.shape)
    touched = {label for g, label in groups.items() if any(touching[cell] for cell in g)}
    assert set(np.flatnonzero(found.touched_by(touching)).tolist()) == touched


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


def room_with_a_wall(first, last, gap, thickness, turned):
    """Two rooms beside each other and a wall between them, columns 12 and on, with a gap."""
    occupied = np.zeros((31, 40), dtype=bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[:, 12 : 12 + thickness] = True
    occupied[first:last, 12 : 12 + thickness] = False
    return occupied.T.copy() if turned else occupied


def basins_of(occupied):
    return np.where(occupied, -1, 0).astype(np.int32)


def narrowest_cells(occupied, squared, first, last, thickness, turned):
    inside = np.zeros_like(occupied)
    (inside.T if turned else inside)[first:last, 12 : 12 + thickness] = True
    widest = squared[inside].max()
    return [tuple(cell) for cell in np.argwhere(inside & (squared == widest)).tolist()]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("thickness", [1, 2, 3, 7])
@pytest.mark.parametrize("gap", [1, 2, 3, 8])
def test_the_bar_lies_across_the_middle_of_the_door(gap, thickness, turned):
    first = 9
    last = first + gap
    occupied = room_with_a_wall(first, last, gap, thickness, turned)
    squared = squared_distance(occupied)
    cells = narrowest_cells(occupied, squared, first, last, thickness, turned)
    assert len(cells) >= thickness
    for cell in cells:  # any of them may be the saddle
        ends = gap_at(squared, basins_of(occupied), cell)
        if turned:
            ends = [end[::-1] for end in ends]
        (low, column), (high, other) = ends
        assert (low, high) == (first - 1, last)
        assert column == other
        assert abs(column - (12 + (thickness - 1) / 2)) <= 0.5


def test_the_ridge_does_not_run_along_the_walls_of_rooms():
    # The saddle is as far from the wall as are the cells along it.
    occupied = np.zeros((30, 40), dtype=bool)
    occupied[0] = True
    occupied[4, 6] = True
    squared = squared_distance(occupied)
    assert squared[2, 6] == squared[2, 30] == 4
    assert gap_at(squared, basins_of(occupied), (2, 6)) == ((0.0, 6.0), (4.0, 6.0))


def test_a_diagonal_gap_is_crossed_from_corner_to_corner():
    occupied = np.zeros((20, 20), dtype=bool)
    for k in range(20):
        occupied[k, k] = True
        occupied[k, min(k + 1, 19)] = True
    for k in (8, 9, 10):
        occupied[k, k : k + 2] = False
    squared = squared_distance(occupied)
    along = [(k, k) for k in range(7, 12)] + [(k, k + 1) for k in range(7, 12)]
    saddle = max(along, key=lambda cell: squared[cell])
    first, second = gap_at(squared, basins_of(occupied), saddle)
    assert {first, second} <= {(7.0, 7.0), (7.0, 8.0), (11.0, 11.0), (11.0, 12.0)}
    assert first[0] == 7
    assert second[0] == 11


def test_where_there_is_no_obstacle_opposite_the_bar_ends_where_ways_do():
    occupied = np.zeros((12, 20), dtype=bool)
    occupied[2] = True
    basins = basins_of(occupied)
    basins[6:, 9:12] = -1  # unknown
    squared = squared_distance(occupied)
    assert gap_at(squared, basins, (5, 10)) == ((2.0, 10.0), (6.0, 10.0))


def test_the_edge_is_an_obstacle():
    occupied = np.zeros((12, 20), dtype=bool)
    occupied[2] = True
    squared = squared_distance(np.pad(occupied, 1, constant_values=True))[1:-1, 1:-1]
    assert gap_at(squared, basins_of(occupied), (7, 8)) == ((2.0, 9.0), (12.0, 9.0))
    alone = np.ones((1, 1), dtype=np.int32)
    assert gap_at(alone, basins_of(alone == 0), (0, 0)) == ((-1.0, 0.0), (1.0, 0.0))


def test_the_bar_lies_in_the_middle_of_a_long_door():
    occupied = np.ones((9, 300), dtype=bool)
    occupied[1:8, 1:20] = occupied[1:8, 280:299] = False
    occupied[3:6, 20:280] = False
    squared = squared_distance(occupied)
    for col in (25, 140, 275):
        ends = gap_at(squared, basins_of(occupied), (4, col))
        assert ends == ((2, pytest.approx(149.5, abs=1)), (6, pytest.approx(149.5, abs=1)))
