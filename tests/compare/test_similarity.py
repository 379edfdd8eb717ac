"""Structural similarity, against its formula written out window by window."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal.compare import score as comparing
from mapdeal.compare.score import gaussian_similarity, uniform_similarity
from mapdeal.kernels.threads import use_threads

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
