"""The figures of a score, against all cells and all pairs of cells."""

import hashlib
import importlib.util
import math
from collections import defaultdict
from unittest.mock import ANY

import numpy as np
import pytest
from hypothesis import given, strategies as st
from PIL import Image

import oracles
from mapdeal import OccupancyGrid, ParameterError, ScoreBound, read_map
from mapdeal.compare import score
from mapdeal.compare.score import FREE, OCCUPIED, UNKNOWN, compare_states, uniform_similarity
from mapdeal.grid.frame import Frame, Transform
from mapdeal.kernels.components import touching_groups
from mapdeal.kernels.threads import use_threads
from recorded_scores import PAIRS, agreement, flat, recorded_pairs
from strategies import examples

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 12))


def walls_of(states):
    return [tuple(cell) for cell in np.argwhere(states == OCCUPIED)]


def by_hand(sources, targets, cell):
    """Return figures of distances, each from all pairs of cells."""
    empty = dict.fromkeys(("mean", "median", "p95", "max", "share_lt_0p1", "share_le_0p1"))
    if not sources or not targets:
        return {"n": len(sources), **empty}
    squares = np.array([min((a - c) ** 2 + (b - d) ** 2 for c, d in targets) for a, b in sources])
    metres = np.sqrt(squares) * cell
    median, p95 = np.quantile(metres, [0.5, 0.95])
    return {
        "n": len(metres), "mean": metres.mean(), "median": median, "p95": p95, "max": metres.max(),
        "share_lt_0p1": (squares < 4).mean(), "share_le_0p1": (squares <= 4).mean(),
    }  # fmt: skip


@given(SHAPES, st.integers(0, 10_000), st.floats(0.0, 0.9))
def test_distances_are_those_of_all_pairs_of_cells(shape, seed, without):
    rng = np.random.default_rng(seed)
    some = rng.integers(0, 3, (2, *shape), dtype=np.uint8)
    estimate, truth = np.where(rng.random(some.shape) < without, np.uint8(UNKNOWN), some)
    values = compare_states(estimate, truth, Frame(*shape, 0.05)).values
    own, true = walls_of(estimate), walls_of(truth)
    in_known = [cell for cell in own if truth[cell] != UNKNOWN]
    of_known = [cell for cell in true if estimate[cell] != UNKNOWN]
    for name, sources, targets in [
        ("dist_est_to_truth_m", own, true),
        ("dist_truth_to_est_m", true, own),
        ("dist_est_to_truth_where_truth_known_m", in_known, true),
        ("dist_truth_to_est_where_est_known_m", of_known, own),
    ]:
        for figure, value in by_hand(sources, targets, 0.05).items():
            expected = None if value is None else pytest.approx(value, rel=1e-12)
            assert values[name][figure] == expected, (name, figure)


def counted(estimate, truth):
    def part(few, many):
        return few.sum() / many.sum() if many.any() else None

    def table(some):
        is_own, is_true = own_walls[some], true_walls[some]
        cells = is_own & is_true, ~is_own & ~is_true, is_own & ~is_true, ~is_own & is_true
        count = {k: mask.sum() for k, mask in zip(("tp", "tn", "fp", "fn"), cells, strict=True)}
        has_both = len(np.unique(is_own)) == len(np.unique(is_true)) == 2
        return count, float(np.corrcoef(is_own, is_true)[0, 1]) if has_both else None

    (own_walls, own_free, own_known), (true_walls, true_free, true_known) = (
        (states == OCCUPIED, states == FREE, states != UNKNOWN) for states in (estimate, truth)
    )
    both, hits = own_known & true_known, own_walls & true_walls
    of_known, mcc_known = table(both)
    on_lattice, mcc_on_lattice = table(np.ones_like(both))
    return {
        "iou_occupied": part(hits, own_walls | true_walls),
        "iou_free": part(own_free & true_free, own_free | true_free),
        "precision_occupied_known_in_both": part(hits, own_walls & true_known),
        "recall_occupied_known_in_both": part(hits, true_walls & own_known),
        "coverage": part(both, true_known),
        "coverage_free": part(true_free & own_known, true_free),
        "known_in_both": both.sum(),
        "mcc_known_in_both": mcc_known,
        "confusion_known_in_both": of_known,
        "mcc_whole_lattice": mcc_on_lattice,
        "confusion_whole_lattice": on_lattice,
    }


@given(SHAPES, st.integers(0, 10_000))
def test_counts_and_shares_are_those_of_the_cells(shape, seed):
    estimate, truth = np.random.default_rng(seed).integers(0, 3, (2, *shape), dtype=np.uint8)
    values = compare_states(estimate, truth, Frame(*shape, 0.2)).values
    for name, value in counted(estimate, truth).items():
        expected = pytest.approx(value, abs=1e-12) if isinstance(value, float) else value
        assert values[name] == expected, name
    assert values["cells"] == list(shape)


def test_two_cells_of_5_cm_are_not_less_than_10_cm_and_four_of_25_mm_neither():
    for cell, apart in ((0.05, 2), (0.025, 4), (0.1, 1), (0.1 / 3, 3)):
        truth, estimate = np.full((2, 1, 9), FREE, np.uint8)
        truth[0, 0], estimate[0, apart] = OCCUPIED, OCCUPIED
        found = compare_states(estimate, truth, Frame(1, 9, cell)).values["dist_est_to_truth_m"]
        assert (found["share_lt_0p1"], found["share_le_0p1"]) == (0.0, 1.0)


@given(
    st.integers(0, 1000), st.floats(-2, 2), st.floats(-2, 2), st.floats(-3.1, 3.1),
    st.sampled_from([0.25, 0.3, 0.5]), st.floats(-3, 3), st.floats(-3, 3),
)  # fmt: skip
def test_the_estimate_is_looked_up_at_the_centres_of_the_truth_and_values_between_are_unknown(
    seed, dx, dy, turn, cell, own_yaw, yaw
):
    rng, of_cells = np.random.default_rng(seed), [-1, 0, 0, 1, 50, 99, 100, 100]
    estimate = OccupancyGrid(rng.choice(of_cells, (7, 9)), cell, (0.4, -0.7, own_yaw))
    truth = OccupancyGrid(rng.choice(of_cells, (5, 8)), 0.37, (-0.3, 0.2, yaw))
    compared = score.compare_to_truth(estimate, truth, Transform(dx, dy, turn))
    found, states = compared.estimate, defaultdict(lambda: UNKNOWN, {0: FREE, 100: OCCUPIED})
    assert compared.truth.ravel().tolist() == [states[v] for v in truth.occupancy.flat]
    for row, col in np.ndindex(5, 8):
        x, y = turned((col + 0.5) * 0.37, (row + 0.5) * 0.37, yaw)
        value = oracles.value_at(estimate, turned(x - 0.3 - dx, y + 0.2 - dy, -turn), 1e-6)
        assert value is None or found[row, col] == states[value]


def turned(x, y, angle):
    return (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle))


PIXELS = np.array([0.5, 1.0, 0.0])  # unknown, free, occupied


def by_windows(first, second, weights, correction):
    """Return the mean of the formula over all windows that lie in the maps."""
    c1, c2 = 0.0001, 0.0009
    found = []
    for x, y in zip(*(windows(PIXELS[s], weights.shape) for s in (first, second)), strict=True):
        ux, uy = (weights * x).sum(), (weights * y).sum()
        vx, vy = (correction * (weights * (z - u) ** 2).sum() for z, u in ((x, ux), (y, uy)))
        vxy = correction * (weights * (x - ux) * (y - uy)).sum()
        over = (2 * ux * uy + c1) * (2 * vxy + c2)
        found.append(over / ((ux**2 + uy**2 + c1) * (vx + vy + c2)))
    return float(np.mean(found))


def windows(values, shape):
    return np.lib.stride_tricks.sliding_window_view(values, shape).reshape(-1, *shape)


BELL = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
BELL = np.outer(BELL, BELL) / BELL.sum() ** 2


@examples(15)
@given(st.integers(11, 17), st.integers(11, 21), st.integers(0, 999))
def test_both_are_the_formula_over_all_windows(height, width, seed):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 3, (height, width), dtype=np.uint8)
    noise = rng.integers(0, 3, first.shape, dtype=np.uint8)
    second = np.where(rng.random(first.shape) < 0.3, noise, first)
    expected = by_windows(first, second, np.full((7, 7), 1 / 49), 49 / 48)
    assert uniform_similarity(first, second) == pytest.approx(expected, abs=1e-12)
    expected = by_windows(first, second, BELL, 1.0)
    assert score.gaussian_similarity(first, second) == pytest.approx(expected, abs=1e-12)


def test_bands_and_threads_change_nothing(monkeypatch):
    rng = np.random.default_rng(3)
    first, second = rng.integers(0, 3, (2, 400, 131), dtype=np.uint8)
    walls, found = rng.random((400, 140)) < 0.2, []
    for together, rows, cols, threads in ((1 << 20,) * 3 + (1,), (9000, 37, 91, 2), (1, 333, 7, 2)):
        monkeypatch.setattr(score, "TOGETHER", together)
        monkeypatch.setattr(score, "LEAST_ROWS_ALONE", rows)
        monkeypatch.setattr(score, "ACROSS_ALONE", cols)
        with use_threads(threads):
            likeness = [f(first, second) for f in (uniform_similarity, score.gaussian_similarity)]
            found.append((likeness, score.corners_of(walls).tobytes()))
    assert any(found[0][1])
    assert found[1:] == found[:1] * 2
    monkeypatch.setattr(score, "_ACROSS", 100)  # sums are rounded in another order
    likeness = [f(first, second) for f in (uniform_similarity, score.gaussian_similarity)]
    assert likeness == pytest.approx(found[0][0], rel=1e-14)


def test_maps_smaller_than_a_window_have_none():
    square, row = np.ones((6, 40), np.uint8), np.ones((8, 10), np.uint8)
    assert uniform_similarity(square, square) is None
    assert uniform_similarity(row, row) == 1.0
    assert score.gaussian_similarity(row, row) is None


def rooms():
    """Three closed rooms side by side, of 8 x 9 cells each; free within, unknown around."""
    states = np.full((20, 42), UNKNOWN, np.uint8)
    states[5:15, 4:35] = OCCUPIED
    for col in (5, 15, 25):
        states[6:14, col : col + 9] = FREE
    return states


def scored(states, cell=0.1):
    return score.score_alone(states, Frame(*states.shape, cell, (1.0, -2.0, 0.4)))


@pytest.mark.parametrize(("cells", "state", "areas"), [
    (np.s_[0, 0], UNKNOWN, 3),  # nothing
    (np.s_[4:6, 18], FREE, 2),  # a door outside
    (np.s_[8, 14], FREE, 2),  # from room to room
    (np.s_[5, 18], UNKNOWN, 2),  # nobody knows whether it is closed
])  # fmt: skip
def test_three_closed_rooms_are_three_areas_and_a_door_outside_opens_one(cells, state, areas):
    states = rooms()
    states[cells] = state
    size = pytest.approx(3 * 72 * 0.01) if areas == 3 else ANY
    assert score.enclosed_areas(states, 0.1) == (areas, 0, size)


def test_a_wall_over_corners_is_closed_and_its_unknown_inside_is_no_area():
    away = np.add.outer(abs(np.arange(15) - 7), abs(np.arange(17) - 8))
    states = np.where(away == 5, OCCUPIED, FREE).astype(np.uint8)
    assert score.enclosed_areas(states, 0.5)[:2] == (1, 0)
    assert score.enclosed_areas(states, 0.05)[:2] == (0, 1)  # 41 cells of 0.0025 m2
    states[away < 5] = UNKNOWN
    assert score.enclosed_areas(states, 0.5)[:2] == (0, 0)


def thick_line(shape, ends, thickness):
    (y0, x0), (y1, x1) = ends
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    length = math.hypot(y1 - y0, x1 - x0)
    along = ((rows - y0) * (y1 - y0) + (cols - x0) * (x1 - x0)) / length
    away = abs((rows - y0) * (x1 - x0) - (cols - x0) * (y1 - y0)) / length
    return (along >= -thickness / 2) & (along <= length + thickness / 2) & (away <= thickness / 2)


def corner_places(walls):
    cells, groups = touching_groups(score.corners_of(walls))
    return [cells[groups == group].mean(axis=0) for group in range(groups.max(initial=-1) + 1)]


@pytest.mark.parametrize("thickness", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("degrees", [0, 7, 22, 45, 68, 131])
def test_an_l_has_a_corner_at_its_bend_and_one_at_each_end(degrees, thickness):
    bend, angles = np.array([45.0, 43.0]), np.radians([degrees, degrees + 90])
    arms = bend + 30 * np.column_stack([np.sin(angles), np.cos(angles)])
    first_arm, second_arm = (thick_line((91, 87), (bend, arm), thickness) for arm in arms)
    found = corner_places(first_arm | second_arm)
    assert len(found) == 3
    for place in (bend, *arms):
        assert min(np.abs(place - corner).max() for corner in found) <= 4


def test_a_wide_circle_has_no_corners():
    rows, cols = np.mgrid[:81, :85]
    assert not score.corners_of(abs(np.hypot(rows - 40, cols - 42) - 35) <= 0.8).any()


@examples(15)
@given(st.integers(0, 10_000), st.sampled_from([0.5, 0.9, 0.97]))
def test_which_way_is_north_changes_no_count(seed, threshold):
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 2, (31, 44), dtype=np.uint8)
    for _ in range(6):
        row, col = rng.integers(0, 30), rng.integers(0, 40)
        states[row : row + rng.integers(1, 12), col : col + rng.integers(1, 12)] = OCCUPIED
    states[rng.random(states.shape) > threshold] = OCCUPIED
    found = scored(states)
    for turned in (np.rot90(states), states[::-1], states.T):
        assert {**scored(np.ascontiguousarray(turned)), "cells": 0} == {**found, "cells": 0}


def test_shares_walls_and_their_thickness_are_counted_if_there_are_any():
    states = np.full((4, 10), UNKNOWN, np.uint8)
    states[:, :5] = FREE
    states[0:2, 0:4] = OCCUPIED  # 8 cells, 2 thick
    states[3, 4] = OCCUPIED
    values = scored(states, 0.25)
    assert values["cells"] == [4, 10]
    assert (values["share_occupied"], values["share_free"]) == (9 / 40, 11 / 40)
    assert (values["share_unknown"], values["share_occupied_of_known"]) == (0.5, 9 / 20)
    assert (values["wall_cells"], values["wall_pieces"], values["specks"]) == (9, 1, 1)
    assert values["share_one_cell_thick"] == 1 / 9
    thick = sorted([0.5] * 8 + [0.25])
    assert values["wall_thickness_m"] == {
        "mean": pytest.approx(sum(thick) / 9), "median": 0.5, "p95": 0.5, "max": 0.5,
    }  # fmt: skip
    values = scored(np.full((3, 4), UNKNOWN, np.uint8))
    assert values["share_occupied_of_known"] is None
    assert values["wall_thickness_m"] == dict.fromkeys(("mean", "median", "p95", "max"))
    assert (values["corners"], values["enclosed_areas"], values["specks"]) == (0, 0, 0)


def test_every_figure_has_a_name_but_the_map_s_size():
    values, names = scored(rooms()), score.figures_named(with_truth=False)
    assert all(score.figure_in(values, name) is not None for name in names)
    plain = {name for name, value in values.items() if not isinstance(value, dict)}
    assert plain - set(names) == {"cells", "resolution_m"}
    states = np.full((2, 3), 2, np.uint8)
    values = compare_states(states, states, Frame(2, 3, 0.3)).values
    assert set(score.figures_named(with_truth=True)) == set(flat(values)) - {"cells"}


@pytest.mark.parametrize(("side", "allowed", "found", "holds"), [
    ("max", 0.3, 0.30000000000000004, True), ("max", 0.3, 0.3001, False),
    ("max", 0.0, 1e-12, False), ("max", 1.0, None, False),
    ("min", 0.9, 0.9, True), ("min", 0.9, 0.8999, False), ("min", -0.5, -0.4, True),
])  # fmt: skip
def test_a_bound_holds(side, allowed, found, holds):
    assert ScoreBound("coverage", side, allowed, found).holds is holds


@pytest.mark.parametrize(("minimum", "maximum", "with_truth", "message", "hint"), [
    ({}, {"zzzz": 1}, True, "is not a figure", "--json"),
    ({"coverage": 1}, {}, False, "needs a truth", "--truth"),
    ({}, {"dist_est_to_truth_m": 1}, True, "several figures", "dist_est_to_truth_m.mean"),
    ({"coverage": "1"}, {}, True, "finite", None),
    ({"coverage": 0.9}, {"coverage": 0.8}, True, "at least 0.9 and at most 0.8", None),
    ({"cells": 1}, {}, True, "is not a figure", None),
])  # fmt: skip
def test_what_cannot_be_a_bound_is_refused(minimum, maximum, with_truth, message, hint):
    with pytest.raises(ParameterError) as error:
        score.checked_bounds(minimum, maximum, with_truth=with_truth)
    assert message in str(error.value)
    assert hint is None or hint in error.value.hint


def test_names_lead_into_groups():
    least, most = {"coverage": 0.5}, {"confusion-known-in-both.fp": 3}
    bounds = score.checked_bounds(least, most, with_truth=True)
    found = score.judged(bounds, {"coverage": None, "confusion_known_in_both": {"fp": 4}})
    expected = {"coverage": None, "confusion_known_in_both.fp": 4.0}
    assert {bound.name: bound.found for bound in found} == expected
    assert not any(bound.holds for bound in found)


def test_a_speck_changes_neither_areas_nor_corners():
    states = rooms()
    found = scored(states)
    states[9, 20], states[2, 2] = OCCUPIED, OCCUPIED
    spoilt = scored(states)
    assert (found["specks"], spoilt["specks"]) == (0, 2)
    for name in ("corners", "enclosed_areas", "enclosed_pockets", "wall_pieces"):
        assert found[name] == spoilt[name], name


GREYS = {UNKNOWN: 205, FREE: 254, OCCUPIED: 0}


def states_in(path):
    greys = np.asarray(Image.open(path))[::-1]
    states = np.full(greys.shape, 9, np.uint8)
    for state, grey in GREYS.items():
        states[greys == grey] = state
    return states


def disagreeing(values, pair):
    agreements = agreement(values, pair["values"])
    assert len(agreements) == 48
    return [name for name, agrees in agreements.items() if not agrees]


@pytest.mark.parametrize("name", PAIRS[3:])  # of the others the maps are
def test_all_values_of_the_stored_cells_are_those_recorded(real_maps, name):
    pair = recorded_pairs(real_maps)[name]
    lattice = pair["lattice"]
    estimate, truth = (states_in(real_maps / lattice[k]["file"]) for k in ("est", "truth"))
    frame = Frame(*truth.shape, pair["resolution"])
    assert disagreeing(compare_states(estimate, truth, frame).values, pair) == []


@pytest.mark.parametrize("name", [*PAIRS[:3], pytest.param(PAIRS[3], marks=pytest.mark.thorough)])
def test_all_values_of_the_maps_are_those_recorded(real_maps, name):
    pair = recorded_pairs(real_maps)[name]
    place = pair["est_to_truth"]
    transform = Transform(place["dx"], place["dy"], math.radians(place["dtheta_deg"]))
    if name == PAIRS[3]:
        maps = generated(real_maps)
    else:
        maps = [read_map(real_maps / pair[which]) for which in ("est", "truth")]
    found = score.compare_to_truth(*maps, transform)
    for which, states in (("est", found.estimate), ("truth", found.truth)):
        greys = np.array([GREYS[state] for state in range(3)], np.uint8)[states[::-1]]
        digest = hashlib.sha256(greys.tobytes()).hexdigest()
        assert digest == pair["lattice"][which]["sha256_cells_image_order"]
    assert disagreeing(found.values, pair) == []


def generated(folder):
    spec = importlib.util.spec_from_file_location("make_pairs", folder / "align" / "make_pairs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    name, recipe = module.RECIPES[2]
    assert name == "any"
    source, resolution, _ = module.SOURCES["visible"]["conestogo"]
    cells = module.load(folder / source)
    rng = np.random.Generator(np.random.PCG64([20, 2, 2]))
    truth, estimate, _ = module.pair(cells, resolution, rng, recipe)
    table = np.zeros(256, np.int8)
    table[[0, 205, 254]] = 100, -1, 0
    return [OccupancyGrid(table[states], *place) for states, *place in (estimate, truth)]


@pytest.mark.parametrize(("name", "reason"), [
    ("dist_est_to_truth_m.mean", "one of the maps has no walls to measure"),
    ("ssim_gauss", "the truth is smaller than a window"),
    ("coverage_free", "the truth has no such cells"),
    ("iou_free", "there are no such cells"),
])  # fmt: skip
def test_figures_that_are_missing_are_explained(name, reason):
    assert score.why_missing(name, {"known_in_both": 5}) == reason
