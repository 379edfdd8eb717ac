import tracemalloc
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

import oracles
from drawn import cells
from mapdeal.kernels import components
from mapdeal.kernels.components import Components
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


@pytest.mark.parametrize("share", [0.02, 0.35, 0.41, 0.6, 0.97])
@pytest.mark.parametrize("height", [1, 7, 300])
def test_sizes_are_those_of_scipy(share, height):
    """0.41 is where components of the size of the grid appear, and bands are joined most."""
    marked = np.random.default_rng(3).random((300, 211)) < share
    labels, _ = ndimage.label(marked, structure=np.ones((3, 3)))
    assert measured(marked, [height]) == Counter(np.bincount(labels.reshape(-1))[1:].tolist())


def test_a_snake_through_all_bands_is_one_component_and_two_combs_become_one():
    snake = cells("""
        #########.#
        #.......#..
        #.#####.#.#
        #.#...#.#.#
        #.#.###.#..
        #.#.....#..
        #.#######..
    """)
    marked = snake == 100
    assert measured(marked, [1]) == Counter([1, 2, int(marked.sum()) - 3])
    comb = np.zeros((6, 9), bool)
    comb[:5, ::2] = True
    assert measured(comb, [2]) == Counter([5] * 5)
    comb[5] = True
    assert measured(comb, [2]) == Counter([5 * 5 + 9])
    assert measured(comb[::-1], [2]) == Counter([5 * 5 + 9])


def test_nothing_is_connected_around_the_border():
    marked = cells("#...#\n.....\n#...#") == 100
    assert measured(marked, [1]) == Counter([1] * 4)


def test_grids_without_marked_cells_and_of_one_cell():
    assert measured(np.zeros((3, 4), bool), [2]) == Counter()
    assert measured(np.ones((1, 1), bool), [1]) == Counter([1])
    assert [listed.tolist() for listed in Components().sizes()] == [[], []]


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
