"""Bounds on figures: their names, and what is within them."""

import math

import numpy as np
import pytest

from mapdeal import ParameterError, ScoreBound
from mapdeal.compare.bounds import checked_bounds, figures_named, judged
from mapdeal.compare.score import compare_states
from mapdeal.grid.frame import Frame
from recorded_scores import flat


def test_every_figure_of_a_comparison_can_have_a_bound_but_its_size():
    states = np.full((2, 3), 2, np.uint8)
    values = compare_states(states, states, Frame(2, 3, 0.3)).values
    assert set(figures_named(with_truth=True)) == set(flat(values)) - {"cells"}


@pytest.mark.parametrize(
    ("side", "allowed", "found", "holds"),
    [
        ("max", 0.3, 0.30000000000000004, True),
        ("max", 0.3, 0.3001, False),
        ("min", 0.9, 0.9, True),
        ("min", 0.9, 0.8999, False),
        ("min", -0.5, -0.4, True),
        ("max", 0.0, 1e-12, False),
        ("max", 1.0, None, False),
    ],
)
def test_a_bound_holds(side, allowed, found, holds):
    assert ScoreBound("coverage", side, allowed, found).holds is holds


@pytest.mark.parametrize(
    ("minimum", "maximum", "with_truth", "told", "hint"),
    [
        ({"coverge": 1}, {}, True, "is not a figure of a score, got 'coverge'", "mean coverage?"),
        ({}, {"zzzz": 1}, True, "is not a figure", "--json"),
        ({"coverage": 1}, {}, False, "needs a truth", "--truth"),
        ({"corners": 1}, {}, True, "without a truth", "leave --truth out"),
        ({}, {"dist_est_to_truth_m": 1}, True, "several figures", "dist_est_to_truth_m.mean"),
        ({"coverage": math.nan}, {}, True, "finite", None),
        ({"coverage": "1"}, {}, True, "finite", None),
        ({"coverage": 0.9}, {"coverage": 0.8}, True, "at least 0.9 and at most 0.8", None),
        ({"cells": 1}, {}, True, "is not a figure", None),
    ],
)
def test_what_cannot_be_a_bound_is_refused(minimum, maximum, with_truth, told, hint):
    with pytest.raises(ParameterError) as error:
        checked_bounds(minimum, maximum, with_truth=with_truth)
    assert told in str(error.value)
    assert hint is None or hint in error.value.hint


def test_names_lead_into_groups():
    maximum = {"confusion-known-in-both.fp": 3}
    bounds = checked_bounds({"coverage": 0.5}, maximum, with_truth=True)
    found = judged(bounds, {"coverage": None, "confusion_known_in_both": {"fp": 4}})
    assert [(one.name, one.found, one.holds) for one in found] == [
        ("coverage", None, False),
        ("confusion_known_in_both.fp", 4.0, False),
    ]
