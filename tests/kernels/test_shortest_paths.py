import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels.paths import cheapest_path


@st.composite
def fields(draw, longest=9):
    """Weights, some of them 0, with two open cells."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    choices = draw(st.sampled_from([[1.0], [1.0, 1.5, 3.0], [1.0, 1.01, 7.3, 100.0]]))
    weights = rng.choice(choices, size=(height, width))
    weights[rng.random((height, width)) < draw(st.sampled_from([0.0, 0.2, 0.4, 0.6]))] = 0.0
    cells = [draw(st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))) for _ in "ab"]
    for cell in cells:
        weights[cell] = max(weights[cell], 1.0)
    return weights, *cells


def _cost_of(weights, cells):
    total = 0.0
    for (row, col), (r, c) in pairwise(cells):
        assert max(abs(r - row), abs(c - col)) == 1
        assert weights[r, c] > 0
        if r != row and c != col:
            assert weights[r, col] > 0 or weights[row, c] > 0
        total += math.hypot(r - row, c - col) * weights[r, c]
    return total


def _summary_of(found):
    return found.cells.tolist(), found.cost, found.expanded


@st.composite
def surcharged(draw, longest=9):
    weights, start, goal = draw(fields(longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    choices = draw(st.sampled_from([[0.0], [0.0, 0.5, 1.0], [0.0, 0.1, 7.0, 40.0]]))
    return weights, start, goal, rng.choice(choices, size=weights.shape)


@given(surcharged())
def test_a_search_takes_the_least_estimate_first_and_no_cell_twice(each_engine, field):
    weights, start, goal, surcharges = field
    expected = oracles.best_first(weights.tolist(), surcharges.tolist(), start, goal)
    found = cheapest_path(weights, start, goal, surcharges=surcharges)
    assert _summary_of(found) == expected
    assert found.expanded <= np.count_nonzero(weights)
    lowest = oracles.lowest_cost(weights.tolist(), start, goal)
    assert (lowest is None) == (len(found.cells) == 0)
    if lowest is not None:
        assert found.cost >= lowest * (1 - 1e-6)
        assert _cost_of(weights, found.cells.tolist()) == pytest.approx(found.cost, rel=1e-6)


@needs_compiled
@given(surcharged(longest=50), st.booleans())
def test_both_engines_find_the_same_path(field, is_plain):
    *field, surcharges = field
    surcharges = None if is_plain else surcharges
    compiled, twin = by_each_engine(
        lambda: _summary_of(cheapest_path(*field, surcharges=surcharges))
    )
    assert compiled == twin


def test_tiny_weights_stay_open_and_huge_ones_are_refused(each_engine):
    assert len(cheapest_path(np.full((1, 3), 1e-30), (0, 0), (0, 2)).cells) == 3
    with pytest.raises(ValueError, match=r"2\^27"):
        cheapest_path(np.full((1, 3), 1e30), (0, 0), (0, 2))


@pytest.mark.parametrize("goal", [(0, 3), (-1, 0), (0, 1)])
def test_start_and_goal_must_be_open_cells(each_engine, goal):
    with pytest.raises(ValueError, match="open cells"):
        cheapest_path(np.array([[1.0, 0.0, 1.0]]), (0, 0), goal)
