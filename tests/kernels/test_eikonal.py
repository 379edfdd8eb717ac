"""Costs to go, on each engine, against updates in any order."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels.eikonal import costs_to_go
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
    cells = np.ones((201, 161), np.uint8)
    found = costs_to_go(cells, np.array([0.0, 1.0]), np.array([[100, 80]]), np.zeros(1))
    rows, cols = np.indices(cells.shape) - np.array([100, 80]).reshape(2, 1, 1)
    away = np.hypot(rows, cols)
    straight = (rows == 0) | (cols == 0) | (abs(rows) == abs(cols))
    assert found[straight] == pytest.approx(away[straight])
    assert ((found >= away * (1 - 1e-12)) & (found <= away * 1.01 + 0.25)).all()


@pytest.mark.parametrize(("weights", "source"), [([0.0, 1.0], (0, 0)), ([1.0, 1e7], (0, 1))])
def test_closed_sources_and_weights_too_far_apart_are_refused(each_engine, weights, source):
    with pytest.raises(ValueError, match=r"open cells|factor"):
        costs_to_go(
            np.array([[0, 1]], np.uint8), np.array(weights), np.array([source]), np.zeros(1)
        )
