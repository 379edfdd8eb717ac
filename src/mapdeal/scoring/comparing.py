"""Comparison of a map with the true one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame, Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import sampled
from mapdeal.grid.values import FREE as FREE_VALUE
from mapdeal.grid.values import OCCUPIED as OCCUPIED_VALUE
from mapdeal.grid.values import UNKNOWN as UNKNOWN_VALUE
from mapdeal.kernels.distance import squared_distance, unreachable
from mapdeal.kernels.lookup import look_up
from mapdeal.kernels.threads import for_rows, thread_count
from mapdeal.records import dataclass

States = NDArray[np.uint8]
"""`UNKNOWN`, `FREE` or `OCCUPIED`, shape (H, W)."""

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


def states_of(values: NDArray[np.int8]) -> States:
    """Return what cells are.

    Examples
    --------
    >>> states_of(np.array([[-1, 0, 1, 99, 100]], np.int8)).tolist()
    [[0, 1, 0, 0, 2]]
    """
    table = np.full(256, UNKNOWN, dtype=np.uint8)
    table[[FREE_VALUE, OCCUPIED_VALUE]] = FREE, OCCUPIED
    states: States = look_up(values, table)
    return states


_Mask = NDArray[np.bool_]

_NEAR = 0.1
"""Metres within which a wall counts as found."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class WallDistances:
    """Distances of the wall cells of one map to the nearest wall cell of another, metres."""

    n: int
    mean: float | None = None
    median: float | None = None
    p95: float | None = None
    max: float | None = None
    share_lt_0p1: float | None = None
    share_le_0p1: float | None = None


def wall_distances(squares: NDArray[np.signedinteger], resolution: float) -> WallDistances:
    """Return what there is to say of distances.

    Notes
    -----
    Distances are those between cell centres: the root of a whole number of cells, times the
    resolution. The median and the percentile are numpy's (linear). Squares are compared with
    (0.1 / resolution) squared, so that two cells of 0.05 m are exactly 0.1 m.

    Examples
    --------
    >>> found = wall_distances(np.array([0, 1, 4, 9], dtype=np.int32), 0.05)
    >>> found.n, round(found.mean, 3), found.share_lt_0p1, found.share_le_0p1
    (4, 0.075, 0.5, 0.75)
    """
    if not len(squares) or int(squares[0]) == unreachable(squares):
        return WallDistances(len(squares))
    metres = metres_of(squares, resolution)
    limit = (_NEAR / resolution) ** 2
    if math.isclose(limit, round(limit), rel_tol=_ROUNDING):
        limit = round(limit)
    median, p95 = np.percentile(metres, [50, 95])
    return WallDistances(
        len(squares),
        float(metres.mean()),
        float(median),
        float(p95),
        float(metres.max()),
        float(np.count_nonzero(squares < limit) / len(squares)),
        float(np.count_nonzero(squares <= limit) / len(squares)),
    )


def metres_of(squares: NDArray[np.signedinteger], resolution: float) -> NDArray[np.float64]:
    """Return squared distances in cells as metres; infinite where there is nothing to reach."""
    metres = np.sqrt(squares.astype(np.float64))
    metres *= resolution
    metres[squares == unreachable(squares)] = math.inf
    return metres


@dataclass(frozen=True)
class Confusion:
    """Cells by whether the estimate has them occupied, and whether the truth has."""

    tp: int
    tn: int
    fp: int
    fn: int

    @property
    def precision(self) -> float | None:
        """The share of the estimate's occupied cells that are occupied in the truth."""
        return share(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float | None:
        """The share of the truth's occupied cells that are occupied in the estimate."""
        return share(self.tp, self.tp + self.fn)

    @property
    def mcc(self) -> float | None:
        """Matthews' correlation coefficient, -1..1; None where one map has cells of one kind alone.

        Examples
        --------
        >>> Confusion(6, 3, 1, 2).mcc
        0.47809144373375745
        """
        tp, tn, fp, fn = self.tp, self.tn, self.fp, self.fn
        product = (tp + fp) * (tp + fn) * (tn + fp) * (tn + fn)
        return (tp * tn - fp * fn) / math.sqrt(product) if product else None


@dataclass(frozen=True)
class Overlap:
    """Cells of two maps on one lattice, by what they are in each."""

    counts: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, estimate: States, truth: States) -> Overlap:
        """Return the counts of two maps on one lattice.

        Examples
        --------
        >>> estimate, truth = np.array([[2, 1, 0]], np.uint8), np.array([[2, 2, 1]], np.uint8)
        >>> Overlap.of(estimate, truth).counts
        ((0, 0, 0), (1, 0, 0), (0, 1, 1))
        """
        from mapdeal.kernels.lookup import histogram

        pairs = truth * np.uint8(3)
        pairs += estimate
        table = histogram(pairs)[:9].reshape(3, 3).tolist()
        return cls(tuple(tuple(row) for row in table))

    def _in_truth(self, state: int) -> int:
        return sum(self.counts[state])

    def _in_estimate(self, state: int) -> int:
        return sum(row[state] for row in self.counts)

    def iou(self, state: int) -> float | None:
        """Return cells that are of a kind in both maps, per cell that is of it in one or both."""
        both = self.counts[state][state]
        return share(both, self._in_truth(state) + self._in_estimate(state) - both)

    @property
    def known_in_both(self) -> int:
        """Cells that neither map has unknown."""
        known = (FREE, OCCUPIED)
        return sum(self.counts[one][other] for one in known for other in known)

    @property
    def coverage(self) -> float | None:
        """The share of the truth's known cells that the estimate knows."""
        return share(self.known_in_both, self._in_truth(FREE) + self._in_truth(OCCUPIED))

    @property
    def coverage_free(self) -> float | None:
        """The share of the truth's free cells that the estimate knows."""
        free = self.counts[FREE]
        return share(free[FREE] + free[OCCUPIED], sum(free))

    @property
    def known_confusion(self) -> Confusion:
        """Of cells that neither map has unknown."""
        table = self.counts
        return Confusion(
            table[OCCUPIED][OCCUPIED],
            table[FREE][FREE],
            table[FREE][OCCUPIED],
            table[OCCUPIED][FREE],
        )

    @property
    def whole_confusion(self) -> Confusion:
        """Of all cells of the lattice: unknown ones are not occupied."""
        tp = self.counts[OCCUPIED][OCCUPIED]
        fp, fn = self._in_estimate(OCCUPIED) - tp, self._in_truth(OCCUPIED) - tp
        cells = sum(self._in_truth(state) for state in (UNKNOWN, FREE, OCCUPIED))
        return Confusion(tp, cells - tp - fp - fn, fp, fn)


def share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


TOGETHER = 1 << 16
"""Cells of a band of rows on which a thread works."""

_LIBRARIES = 28_000_000
"""scipy.ndimage, and what it loads."""

_PER_CELL, _PER_WALL = 9.2, 12
_OF_BAND, _AROUND = 90, 10
"""Of a comparison: bytes for each cell, each wall cell of both maps, and each cell of a band, with
the rows around it."""

_PER_CELL_ALONE, _PER_WALL_ALONE = 7.2, 52
_OF_BAND_ALONE, _AROUND_ALONE = 60, 40
"""The same of a map on its own."""

LEAST_ROWS_ALONE = 64
"""Rows of a band there: with fewer most of the work would be what lies around them."""

_PER_WALL_DRAWN = 40


def bytes_to_compare(shape: tuple[int, int], walls: int, *, is_drawn: bool = False) -> int:
    """Return about how many bytes it takes to compare a map with the truth, and to draw that."""
    per_wall = _PER_WALL_DRAWN if is_drawn else _PER_WALL
    return _bytes(shape, _PER_CELL, per_wall * walls, _OF_BAND, _AROUND, 1)


def bytes_alone(shape: tuple[int, int], walls: int) -> int:
    """Return about how many bytes it takes to score a map on its own, as `bytes_to_compare`."""
    of_walls = _PER_WALL_ALONE * walls
    return _bytes(shape, _PER_CELL_ALONE, of_walls, _OF_BAND_ALONE, _AROUND_ALONE, LEAST_ROWS_ALONE)


def _bytes(
    shape: tuple[int, int], per_cell: float, of_walls: int, of_band: int, around: int, least: int
) -> int:  # fmt: skip
    height, width = shape
    rows = max(least, TOGETHER // width)
    workers = min(thread_count(), -(-height // rows))
    band = of_band * (min(rows, height) + around) * (width + around)
    return int(_LIBRARIES + per_cell * height * width + of_walls + workers * band)


_Floats = NDArray[np.floating[Any]]
_Moments = tuple[_Floats, _Floats, _Floats, _Floats]
"""Of the windows: both means, the mean of x * y, and that of x * x + y * y."""

_C1, _C2 = 0.01**2, 0.03**2
_UNIFORM = 7
_SIGMA, _TRUNCATE, _GAUSSIAN = 1.5, 3.5, 11


def uniform_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 7 x 7 cells."""
    # With all pixels of a window weighted alike, sample variances (N - 1), K1 = 0.01, K2 = 0.03 and
    # a range of values of 1; windows that reach beyond the map are left out. That is what
    # ``skimage.metrics.structural_similarity`` gives by default. Sums are whole numbers here, so
    # that nothing is rounded before the last step.
    # Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to
    # structural similarity", IEEE Transactions on Image Processing 13(4), 2004.
    count = _UNIFORM**2
    return _mean_similarity(first, second, _UNIFORM, _uniform_moments, count / (count - 1))


def gaussian_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 11 x 11 cells, weighted by a bell."""
    # The weights are those of a Gaussian with a standard deviation of 1.5 cells, the variances
    # those of the population, as Wang et al. have them; ``skimage.metrics.structural_similarity``
    # with ``gaussian_weights=True``, ``sigma=1.5`` and ``use_sample_covariance=False``.
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


Values = dict[str, Any]
"""Figures by name: numbers, None where there is nothing to measure, or more of such."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A map beside the true one, on the lattice of that, and its score."""

    frame: Frame
    estimate: States
    truth: States
    values: Values
    wall_squares: NDArray[np.signedinteger]
    missed: NDArray[np.signedinteger]


def compare_to_truth(
    estimate: OccupancyGrid, truth: OccupancyGrid, transform: Transform | None = None
) -> Comparison:
    """Return the score of a map against the true one."""
    frame = truth.frame
    values = on_lattice(frame, estimate, transform or Transform())
    return compare_states(states_of(values), states_of(truth.occupancy), frame)


def on_lattice(
    frame: Frame, estimate: OccupancyGrid, transform: Transform
) -> NDArray[np.int8]:  # fmt: skip
    """Return the values of a map at the centres of another one's cells; -1 where it has none."""
    values, inside = sampled(frame, estimate.occupancy, transform.frame(estimate.frame))
    values[~inside] = UNKNOWN_VALUE
    return values


def compare_states(estimate: States, truth: States, frame: Frame) -> Comparison:
    """Return the score of a map that is on the lattice of the true one already."""
    walls, true_walls = estimate == OCCUPIED, truth == OCCUPIED
    to_truth = squared_distance(true_walls)[walls]
    to_estimate = squared_distance(walls)[true_walls]
    cell = frame.resolution
    overlap = Overlap.of(estimate, truth)
    known, whole = overlap.known_confusion, overlap.whole_confusion
    values = {
        "cells": list(frame.shape),
        "ssim_uniform7": uniform_similarity(truth, estimate),
        "ssim_gauss": gaussian_similarity(truth, estimate),
        "dist_est_to_truth_m": asdict(wall_distances(to_truth, cell)),
        "dist_truth_to_est_m": asdict(wall_distances(to_estimate, cell)),
        "dist_est_to_truth_where_truth_known_m": asdict(
            wall_distances(to_truth[truth[walls] != UNKNOWN], cell)
        ),
        "dist_truth_to_est_where_est_known_m": asdict(
            wall_distances(to_estimate[estimate[true_walls] != UNKNOWN], cell)
        ),
        "iou_occupied": overlap.iou(OCCUPIED),
        "iou_free": overlap.iou(FREE),
        "precision_occupied_known_in_both": known.precision,
        "recall_occupied_known_in_both": known.recall,
        "coverage": overlap.coverage,
        "coverage_free": overlap.coverage_free,
        "known_in_both": overlap.known_in_both,
        "mcc_known_in_both": known.mcc,
        "confusion_known_in_both": asdict(known),
        "mcc_whole_lattice": whole.mcc,
        "confusion_whole_lattice": asdict(whole),
    }
    return Comparison(frame, estimate, truth, values, to_truth, to_estimate)
