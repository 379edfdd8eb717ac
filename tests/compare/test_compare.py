"""The other figures of a score, against loops over all cells."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import OccupancyGrid
from mapdeal.compare import score as comparing
from mapdeal.compare.score import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    compare_states,
    compare_to_truth,
    gaussian_similarity,
    uniform_similarity,
)
from mapdeal.grid.frame import Frame, Transform
from mapdeal.kernels.threads import use_threads

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 12))


def walls_of(states):
    return [tuple(cell) for cell in np.argwhere(states == OCCUPIED)]


def by_hand(sources, targets, cell):
    """Return figures of distances, each from all pairs of cells."""
    empty = dict.fromkeys(("mean", "median", "p95", "max", "share_lt_0p1", "share_le_0p1"))
    if not sources or not targets:
        return {"n": len(sources), **empty}
    squares = [min((a - c) ** 2 + (b - d) ** 2 for c, d in targets) for a, b in sources]
    metres = sorted(math.sqrt(square) * cell for square in squares)

    def at(share):
        place = share * (len(metres) - 1)
        low = math.floor(place)
        high = min(low + 1, len(metres) - 1)
        return metres[low] + (place - low) * (metres[high] - metres[low])

    count = len(metres)
    return {
        "n": count, "mean": math.fsum(metres) / count, "median": at(0.5), "p95": at(0.95),
        "max": metres[-1],
        "share_lt_0p1": sum(square < 4 for square in squares) / count,
        "share_le_0p1": sum(square <= 4 for square in squares) / count,
    }  # fmt: skip


def same(found, expected):
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == (None if value is None else pytest.approx(value, rel=1e-12)), name


@settings(max_examples=60)
@given(SHAPES, st.integers(0, 10_000), st.floats(0.0, 0.9))
def test_distances_are_those_of_all_pairs_of_cells(shape, seed, without):
    rng = np.random.default_rng(seed)
    estimate, truth = np.where(
        rng.random((2, *shape)) < without, UNKNOWN, rng.integers(0, 3, (2, *shape))
    ).astype(np.uint8)
    values = compare_states(estimate, truth, Frame(*shape, 0.05)).values
    own, true = walls_of(estimate), walls_of(truth)
    same(values["dist_est_to_truth_m"], by_hand(own, true, 0.05))
    same(values["dist_truth_to_est_m"], by_hand(true, own, 0.05))
    known = [cell for cell in own if truth[cell] != UNKNOWN]
    same(values["dist_est_to_truth_where_truth_known_m"], by_hand(known, true, 0.05))
    known = [cell for cell in true if estimate[cell] != UNKNOWN]
    same(values["dist_truth_to_est_where_est_known_m"], by_hand(known, own, 0.05))


def counted(estimate, truth):
    """Return the counts and shares, from loops over the cells."""
    cells = list(zip(estimate.ravel().tolist(), truth.ravel().tolist(), strict=True))

    def number(test):
        return sum(1 for e, t in cells if test(e, t))

    def part(few, many):
        return few / many if many else None

    def table(some):
        count = {
            "tp": sum(e == t == OCCUPIED for e, t in some),
            "tn": sum(e != OCCUPIED != t for e, t in some),
            "fp": sum(e == OCCUPIED != t for e, t in some),
            "fn": sum(t == OCCUPIED != e for e, t in some),
        }
        ones, others = [
            [int(state == OCCUPIED) for state in of] for of in zip(*some, strict=True)
        ] or ([], [])
        if len(set(ones)) < 2 or len(set(others)) < 2:
            return count, None
        return count, float(np.corrcoef(ones, others)[0, 1])

    known = [(e, t) for e, t in cells if e and t] or [(0, 0)]
    of_known, mcc_known = table(known)
    if known == [(0, 0)]:
        of_known["tn"] = 0
    whole, mcc_whole = table(cells)
    both = number(lambda e, t: e and t)
    tp = of_known["tp"]
    return {
        "iou_occupied": part(whole["tp"], number(lambda e, t: OCCUPIED in (e, t))),
        "iou_free": part(number(lambda e, t: e == t == FREE), number(lambda e, t: FREE in (e, t))),
        "precision_occupied_known_in_both": part(tp, tp + of_known["fp"]),
        "recall_occupied_known_in_both": part(tp, tp + of_known["fn"]),
        "coverage": part(both, number(lambda _, t: t)),
        "coverage_free": part(number(lambda e, t: t == FREE and e), number(lambda _, t: t == FREE)),
        "known_in_both": both,
        "mcc_known_in_both": mcc_known,
        "confusion_known_in_both": of_known,
        "mcc_whole_lattice": mcc_whole,
        "confusion_whole_lattice": whole,
    }


@settings(max_examples=60)
@given(SHAPES, st.integers(0, 10_000))
def test_counts_and_shares_are_those_of_loops_over_the_cells(shape, seed):
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


@settings(max_examples=30)
@given(
    st.integers(0, 1000), st.floats(-2, 2), st.floats(-2, 2), st.floats(-3.1, 3.1),
    st.sampled_from([0.25, 0.3, 0.5]), st.floats(-3, 3), st.floats(-3, 3),
)  # fmt: skip
def test_the_estimate_is_looked_up_at_the_centres_of_the_truth(
    seed, dx, dy, turn, cell, own_yaw, yaw
):
    rng = np.random.default_rng(seed)
    estimate = OccupancyGrid(rng.choice([-1, 0, 100], (7, 9)), cell, (0.4, -0.7, own_yaw))
    truth = OccupancyGrid(rng.choice([-1, 0, 100], (5, 8)), 0.37, (-0.3, 0.2, yaw))
    found = compare_to_truth(estimate, truth, Transform(dx, dy, turn)).estimate
    states = {-1: UNKNOWN, 0: FREE, 100: OCCUPIED}
    for row in range(5):
        for col in range(8):
            x, y = (col + 0.5) * 0.37, (row + 0.5) * 0.37
            x, y = turned(x, y, yaw)
            x, y = turned(x - 0.3 - dx, y + 0.2 - dy, -turn)
            x, y = turned(x - 0.4, y + 0.7, -own_yaw)
            x, y = x / cell, y / cell
            if min(abs(x - round(x)), abs(y - round(y))) < 1e-6:
                continue
            i, j = math.floor(y), math.floor(x)
            inside = 0 <= i < 7 and 0 <= j < 9
            assert found[row, col] == (states[estimate.occupancy[i, j]] if inside else UNKNOWN)


def turned(x, y, angle):
    return (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle))


def test_values_between_count_as_unknown():
    values = OccupancyGrid([[0, 1, 20, 65, 99, 100, -1]], 0.5, (1.0, 2.0, 0.5))
    found = compare_to_truth(values, values)
    assert found.truth.tolist() == [[FREE, *[UNKNOWN] * 4, OCCUPIED, UNKNOWN]]
    assert (found.estimate == found.truth).all()


PIXELS = np.array([0.5, 1.0, 0.0])  # unknown, free, occupied


def by_windows(first, second, weights, correction):
    """Return the mean of the formula over all windows that lie in the maps."""
    side = len(weights)
    height, width = first.shape
    found = []
    for row in range(height - side + 1):
        for col in range(width - side + 1):
            x, y = (
                PIXELS[states[row : row + side, col : col + side]] for states in (first, second)
            )
            ux, uy = (weights * x).sum(), (weights * y).sum()
            vx, vy = (
                correction * (weights * (values - mean) ** 2).sum()
                for values, mean in ((x, ux), (y, uy))
            )
            vxy = correction * (weights * (x - ux) * (y - uy)).sum()
            c1, c2 = 0.0001, 0.0009
            found.append(
                (2 * ux * uy + c1) * (2 * vxy + c2) / ((ux**2 + uy**2 + c1) * (vx + vy + c2))
            )
    return float(np.mean(found))


BELL = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
BELL = np.outer(BELL, BELL) / BELL.sum() ** 2
EVEN = np.full((7, 7), 1 / 49)


@settings(max_examples=15)
@given(st.integers(11, 17), st.integers(11, 21), st.integers(0, 999))
def test_both_are_the_formula_over_all_windows(height, width, seed):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 3, (height, width), dtype=np.uint8)
    second = np.where(rng.random(first.shape) < 0.3, rng.integers(0, 3, first.shape), first)
    second = second.astype(np.uint8)
    expected = by_windows(first, second, EVEN, 49 / 48)
    assert uniform_similarity(first, second) == pytest.approx(expected, abs=1e-12)
    expected = by_windows(first, second, BELL, 1.0)
    assert gaussian_similarity(first, second) == pytest.approx(expected, abs=1e-12)


def test_bands_and_threads_change_nothing(monkeypatch):
    rng = np.random.default_rng(3)
    first, second = rng.integers(0, 3, (2, 700, 611), dtype=np.uint8)
    scores = []
    for together, threads in ((1 << 20, 1), (9000, 2)):
        monkeypatch.setattr(comparing, "TOGETHER", together)
        with use_threads(threads):
            scores.append((uniform_similarity(first, second), gaussian_similarity(first, second)))
    assert scores[0] == scores[1]


def test_maps_smaller_than_a_window_have_none():
    one, row = np.ones((6, 40), np.uint8), np.ones((8, 10), np.uint8)
    assert uniform_similarity(one, one) is None
    assert uniform_similarity(row, row) == 1.0
    assert gaussian_similarity(row, row) is None
