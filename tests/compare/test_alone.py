"""What a map says of its own quality, on maps drawn by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import ParameterError, ScoreBound
from mapdeal.compare import score as alone
from mapdeal.compare.bounds import checked_bounds, figure_in, figures_named, judged
from mapdeal.compare.score import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    compare_states,
    corners_of,
    enclosed_areas,
    score_alone,
)
from mapdeal.grid.frame import Frame
from mapdeal.kernels.components import touching_groups
from mapdeal.kernels.threads import use_threads
from recorded_scores import flat


def rooms():
    """Three closed rooms side by side, of 8 x 9 cells each; free within, unknown around."""
    states = np.full((20, 42), UNKNOWN, np.uint8)
    states[5:15, 4:35] = OCCUPIED
    for col in (5, 15, 25):
        states[6:14, col : col + 9] = FREE
    return states


def counted(states, cell=0.1):
    return score_alone(states, Frame(*states.shape, cell, (1.0, -2.0, 0.4)))


def test_three_closed_rooms_are_three_areas_and_a_door_outside_opens_one():
    states = rooms()
    assert enclosed_areas(states, 0.1) == (3, 0, pytest.approx(3 * 72 * 0.01))
    states[4:6, 18] = FREE
    assert enclosed_areas(states, 0.1)[:2] == (2, 0)
    states = rooms()
    states[8, 14] = FREE  # from room to room
    assert enclosed_areas(states, 0.1)[:2] == (2, 0)
    states = rooms()
    states[5, 18] = UNKNOWN  # nobody knows whether it is closed
    assert enclosed_areas(states, 0.1)[:2] == (2, 0)


def test_a_wall_over_corners_is_closed_and_its_unknown_inside_is_no_area():
    states = np.full((15, 17), FREE, np.uint8)
    for row in range(15):
        for col in range(17):
            if abs(row - 7) + abs(col - 8) == 5:
                states[row, col] = OCCUPIED
    assert enclosed_areas(states, 0.5)[:2] == (1, 0)
    assert enclosed_areas(states, 0.05)[:2] == (0, 1)  # 41 cells of 0.0025 m2
    inside = np.add.outer(abs(np.arange(15) - 7), abs(np.arange(17) - 8)) < 5
    states[inside] = UNKNOWN
    assert enclosed_areas(states, 0.5)[:2] == (0, 0)


def thick_line(shape, ends, thickness):
    """Return the cells within half a thickness of a line."""
    (y0, x0), (y1, x1) = ends
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    length = math.hypot(y1 - y0, x1 - x0)
    along = ((rows - y0) * (y1 - y0) + (cols - x0) * (x1 - x0)) / length
    away = abs((rows - y0) * (x1 - x0) - (cols - x0) * (y1 - y0)) / length
    return (along >= -thickness / 2) & (along <= length + thickness / 2) & (away <= thickness / 2)


def corner_places(walls):
    cells, groups = touching_groups(corners_of(walls))
    return [cells[groups == group].mean(axis=0) for group in range(groups.max(initial=-1) + 1)]


@pytest.mark.parametrize("thickness", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("degrees", [0, 7, 22, 45, 68, 90, 131])
def test_an_l_has_a_corner_at_its_bend_and_one_at_each_end(degrees, thickness):
    shape, bend = (91, 87), np.array([45.0, 43.0])
    arms = [
        bend + 30 * np.array([math.sin(angle), math.cos(angle)])
        for angle in (math.radians(degrees), math.radians(degrees + 90))
    ]
    walls = thick_line(shape, (bend, arms[0]), thickness)
    walls |= thick_line(shape, (bend, arms[1]), thickness)
    found = corner_places(walls)
    assert len(found) == 3
    for place in (bend, *arms):
        assert min(np.abs(place - one).max() for one in found) <= 4


@pytest.mark.parametrize("degrees", range(0, 180, 13))
def test_a_line_has_corners_at_its_ends_alone_and_a_wide_circle_none(degrees):
    step = 30 * np.array([math.sin(math.radians(degrees)), math.cos(math.radians(degrees))])
    middle = np.array([40.0, 42.0])
    assert len(corner_places(thick_line((81, 85), (middle - step, middle + step), 1.0))) == 2
    rows, cols = np.mgrid[:81, :85]
    assert not corners_of(abs(np.hypot(rows - 40, cols - 42) - 35) <= 0.8).any()


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.sampled_from([0.5, 0.9, 0.97]))
def test_which_way_is_north_changes_no_count(seed, threshold):
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 2, (31, 44), dtype=np.uint8)
    for _ in range(6):
        row, col = rng.integers(0, 30), rng.integers(0, 40)
        states[row : row + rng.integers(1, 12), col : col + rng.integers(1, 12)] = OCCUPIED
    states[rng.random(states.shape) > threshold] = OCCUPIED
    found = counted(states)
    for turned in (np.rot90(states), states[::-1], states.T):
        assert {**counted(np.ascontiguousarray(turned)), "cells": 0} == {**found, "cells": 0}


def test_bands_and_threads_change_no_corner(monkeypatch):
    walls = np.random.default_rng(5).random((700, 400)) < 0.2
    whole = corners_of(walls)
    assert whole.any()
    monkeypatch.setattr(alone, "TOGETHER", 1)
    for rows in (37, 333):
        monkeypatch.setattr(alone, "LEAST_ROWS_ALONE", rows)
        with use_threads(2):
            assert (corners_of(walls) == whole).all()


def test_shares_walls_and_their_thickness_are_counted():
    states = np.full((4, 10), UNKNOWN, np.uint8)
    states[:, :5] = FREE
    states[0:2, 0:4] = OCCUPIED  # 8 cells, 2 thick
    states[3, 4] = OCCUPIED
    values = counted(states, 0.25)
    assert values["cells"] == [4, 10]
    assert (values["share_occupied"], values["share_free"]) == (9 / 40, 11 / 40)
    assert (values["share_unknown"], values["share_occupied_of_known"]) == (0.5, 9 / 20)
    assert (values["wall_cells"], values["wall_pieces"], values["specks"]) == (9, 1, 1)
    assert values["share_one_cell_thick"] == 1 / 9
    thick = sorted([0.5] * 8 + [0.25])
    assert values["wall_thickness_m"] == {
        "mean": pytest.approx(sum(thick) / 9), "median": 0.5, "p95": 0.5, "max": 0.5,
    }  # fmt: skip


def test_a_map_without_walls_has_no_thickness():
    values = counted(np.full((3, 4), UNKNOWN, np.uint8))
    assert values["share_occupied_of_known"] is None
    assert values["wall_thickness_m"] == dict.fromkeys(("mean", "median", "p95", "max"))
    assert (values["corners"], values["enclosed_areas"], values["specks"]) == (0, 0, 0)


def test_every_figure_has_a_name():
    values = counted(rooms())
    names = figures_named(with_truth=False)
    for name in names:
        assert figure_in(values, name) is not None
    plain = {name for name, value in values.items() if not isinstance(value, dict)}
    assert plain - set(names) == {"cells", "resolution_m"}


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


def test_a_speck_changes_neither_areas_nor_corners():
    states = rooms()
    found = counted(states)
    states[9, 20], states[2, 2] = OCCUPIED, OCCUPIED
    spoilt = counted(states)
    assert (found["specks"], spoilt["specks"]) == (0, 2)
    for name in ("corners", "enclosed_areas", "enclosed_pockets", "wall_pieces"):
        assert found[name] == spoilt[name], name
