"""Costs to go and cheapest paths, on each engine, against updates in any order."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels.paths import cheapest_path, costs_to_go, lengths_to
from strategies import examples


@st.composite
def fields(draw, longest=9):
    """Classes of cells, weights of classes of which 0 is closed, and sources with their costs."""
    shape = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    classes = rng.choice(4, size=shape, p=[0.3, 0.5, 0.1, 0.1]).astype(np.uint8)
    sources = rng.integers(0, shape, (draw(st.integers(1, 3)), 2))
    classes[tuple(sources.T)] = 1
    weights = np.array([0.0, *draw(st.sampled_from([(1, 1, 1), (1, 1.3, 2.5), (0.1, 90, 7)]))])
    return classes, weights, sources, rng.random(len(sources)) * draw(st.sampled_from([0, 1, 9]))


@examples(80)
@given(fields())
def test_costs_are_those_that_no_update_lowers(each_engine, field):
    classes, weights, sources, starts = field
    found = costs_to_go(classes, weights, sources, starts)
    lowest = {}
    for cell, start in zip(map(tuple, sources.tolist()), starts.tolist(), strict=True):
        lowest[cell] = min(start, lowest.get(cell, math.inf))
    assert found.tolist() == oracles.costs_to_go(weights[classes].tolist(), lowest)


@needs_compiled
@given(fields(longest=60))
def test_both_engines_give_the_same_bytes(field):
    compiled, twin = by_each_engine(lambda: costs_to_go(*field).tobytes())
    assert compiled == twin


def test_far_away_costs_are_lengths_and_exact_along_eight_directions(each_engine):
    assert len(cheapest_path(np.full((1, 3), 1e-30), (0, 0), (0, 2)).cells) == 3  # tiny, but open
    cells = np.ones((201, 161), np.uint8)
    found = costs_to_go(cells, np.array([0.0, 1.0]), np.array([[100, 80]]), np.zeros(1))
    rows, cols = np.indices(cells.shape) - np.array([100, 80]).reshape(2, 1, 1)
    away = np.hypot(rows, cols)
    straight = (rows == 0) | (cols == 0) | (abs(rows) == abs(cols))
    assert found[straight] == pytest.approx(away[straight])
    assert ((found >= away * (1 - 1e-12)) & (found <= away * 1.01 + 0.25)).all()
    near = (abs(rows) <= 10) & (abs(cols) <= 10)
    assert lengths_to(cells == 1, (100.5, 80.5))[near] == pytest.approx(away[near])


def _cost_of(weights, cells):
    total = 0.0
    for (row, col), (r, c) in pairwise(cells):
        assert max(abs(r - row), abs(c - col)) == 1
        assert weights[r, c] > 0
        if r != row and c != col:
            assert weights[r, col] > 0 or weights[row, c] > 0
        total += math.hypot(r - row, c - col) * weights[r, c]
    return total


def _searched(weights, start, goal, surcharges=None):
    found = cheapest_path(weights, start, goal, surcharges=surcharges)
    return found.cells.tolist(), found.cost, found.expanded


@st.composite
def surcharged(draw, longest=9):
    """Weights, some of them 0, with two open cells, and surcharges."""
    shape = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    choices = draw(st.sampled_from([[1.0], [1.0, 1.5, 3.0], [1.0, 1.01, 7.3, 100.0]]))
    weights = rng.choice(choices, size=shape)
    weights[rng.random(shape) < draw(st.sampled_from([0.0, 0.2, 0.4, 0.6]))] = 0.0
    cells = [draw(st.tuples(*(st.integers(0, side - 1) for side in shape))) for _ in "ab"]
    for cell in cells:
        weights[cell] = max(weights[cell], 1.0)
    choices = draw(st.sampled_from([[0.0], [0.0, 0.5, 1.0], [0.0, 0.1, 7.0, 40.0]]))
    return weights, *cells, rng.choice(choices, size=shape)


@given(surcharged())
def test_a_search_takes_the_least_estimate_first_and_no_cell_twice(each_engine, field):
    weights, start, goal, surcharges = field
    cells, cost, expanded = _searched(*field)
    expected = oracles.best_first(weights.tolist(), surcharges.tolist(), start, goal)
    assert (cells, cost, expanded) == expected
    assert expanded <= np.count_nonzero(weights)
    lowest = oracles.lowest_cost(weights.tolist(), start, goal)
    assert (lowest is None) == (cells == [])
    if lowest is not None:
        assert cost >= lowest * (1 - 1e-6)
        assert _cost_of(weights, cells) == pytest.approx(cost, rel=1e-6)


@needs_compiled
@given(surcharged(longest=50), st.booleans())
def test_both_engines_find_the_same_path(field, is_plain):
    compiled, twin = by_each_engine(lambda: _searched(*(field[:3] if is_plain else field)))
    assert compiled == twin
