"""Structural similarity of two maps as pictures: occupied black, unknown grey, free white."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.threads import for_rows
from mapdeal.scoring.memory import TOGETHER
from mapdeal.scoring.states import FREE, OCCUPIED, UNKNOWN, States

_Floats = NDArray[np.floating[Any]]
_Moments = tuple[_Floats, _Floats, _Floats, _Floats]
"""Of the windows: both means, the mean of x * y, and that of x * x + y * y."""

_C1, _C2 = 0.01**2, 0.03**2
_UNIFORM = 7
_SIGMA, _TRUNCATE, _GAUSSIAN = 1.5, 3.5, 11


def uniform_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 7 x 7 cells.

    Notes
    -----
    With all pixels of a window weighted alike, sample variances (N - 1), K1 = 0.01, K2 = 0.03
    and a range of values of 1; windows that reach beyond the map are left out. That is what
    ``skimage.metrics.structural_similarity`` gives by default. Sums are whole numbers here, so
    that nothing is rounded before the last step.

    References
    ----------
    Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to
    structural similarity", IEEE Transactions on Image Processing 13(4), 2004.
    """
    count = _UNIFORM**2
    return _mean_similarity(first, second, _UNIFORM, _uniform_moments, count / (count - 1))


def gaussian_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 11 x 11 cells, weighted by a bell.

    Notes
    -----
    The weights are those of a Gaussian with a standard deviation of 1.5 cells, the variances
    those of the population, as Wang et al. have them;
    ``skimage.metrics.structural_similarity`` with ``gaussian_weights=True``, ``sigma=1.5`` and
    ``use_sample_covariance=False``.
    """
    return _mean_similarity(first, second, _GAUSSIAN, _gaussian_moments, 1.0)


def _mean_similarity(
    first: States,
    second: States,
    window: int,
    moments_of: Callable[[States, States], _Moments],
    correction: float,
) -> float | None:
    height, width = first.shape
    rows, cols = height - window + 1, width - window + 1
    if rows < 1 or cols < 1:
        return None
    a, b = _half_pixels(first), _half_pixels(second)
    sums = np.empty(rows)
    step = max(1, TOGETHER // width)

    def band(part: slice) -> None:
        for start in range(part.start, part.stop, step):
            stop = min(start + step, part.stop)
            under = slice(start, stop + window - 1)
            means = moments_of(a[under], b[under])
            sums[start:stop] = _similarity(means, correction).sum(axis=1)

    for_rows(band, (rows, cols))
    return float(sums.sum() / (rows * cols))


def _half_pixels(states: States) -> States:
    """Return pixels in halves: 0 occupied, 1 unknown, 2 free."""
    table = np.zeros(3, dtype=np.uint8)
    table[[OCCUPIED, UNKNOWN, FREE]] = 0, 1, 2
    halves: States = table[states]
    return halves


def _similarity(moments: _Moments, correction: float) -> _Floats:
    mean_x, mean_y, mean_xy, mean_squares = moments
    product = mean_x * mean_y
    squares = mean_x * mean_x
    squares += mean_y * mean_y
    covariance = (mean_xy - product) * correction
    variances = (mean_squares - squares) * correction
    result: _Floats = (2 * product + _C1) * (2 * covariance + _C2)
    result /= (squares + _C1) * (variances + _C2)
    return result


def _uniform_moments(a: States, b: States) -> _Moments:
    def mean(values: States, part: float) -> _Floats:
        return _window_sums(values) * (part / _UNIFORM**2)

    return mean(a, 0.5), mean(b, 0.5), mean(a * b, 0.25), _squares_mean(a, b)


def _squares_mean(a: States, b: States) -> _Floats:
    sums = _window_sums(a * a).astype(np.float64)
    sums += _window_sums(b * b)
    sums *= 0.25 / _UNIFORM**2
    return sums


def _window_sums(values: States) -> States:
    """Return the sums of all windows; 49 values of at most 4 make a byte."""
    height, width = values.shape
    across = values[:, : width - _UNIFORM + 1].copy()
    for k in range(1, _UNIFORM):
        across += values[:, k : width - _UNIFORM + 1 + k]
    down = across[: height - _UNIFORM + 1].copy()
    for k in range(1, _UNIFORM):
        down += across[k : height - _UNIFORM + 1 + k]
    return down


def _gaussian_moments(a: States, b: States) -> _Moments:
    from scipy.ndimage import gaussian_filter

    edge = _GAUSSIAN // 2

    def mean(values: _Floats) -> _Floats:
        smooth: _Floats = gaussian_filter(values, _SIGMA, truncate=_TRUNCATE)
        return smooth[edge:-edge, edge:-edge]

    x, y = a * 0.5, b * 0.5
    return mean(x), mean(y), mean(x * y), mean(x * x + y * y)
