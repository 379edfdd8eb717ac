"""Comparison of a map with the true one: figures, their names and bounds, and faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.compare import align, difference
from mapdeal.compare.walls import pooled
from mapdeal.grid import values as map_values
from mapdeal.grid.canvas import sampled
from mapdeal.grid.frame import Frame, Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import components, distance, lookup, threads
from mapdeal.kernels.arrays import Mask, unreachable

States = NDArray[np.uint8]  # `UNKNOWN`, `FREE` or `OCCUPIED`, shape (H, W)
UNKNOWN, FREE, OCCUPIED = 0, 1, 2
Values = dict[str, Any]  # numbers by name, or groups of them; None marks missing data


def states_of(values: NDArray[np.int8]) -> States:
    """Return what cells are: of the values only 0 and 100 are known."""
    table = np.full(256, UNKNOWN, dtype=np.uint8)
    table[[map_values.FREE, map_values.OCCUPIED]] = FREE, OCCUPIED
    return lookup.look_up(values, table)


_NEAR = 0.1  # metres within which a wall counts as found
_ROUNDING = 1e-9  # of figures: six cells of 0.05 m are 0.30000000000000004 m


def _wall_distances(squares: NDArray[np.signedinteger], resolution: float) -> Values:
    # Squares are compared, so that two cells of 0.05 m are exactly 0.1 m.
    count = len(squares)
    if count and int(squares[0]) == unreachable(squares):
        squares = squares[:0]
    limit = (_NEAR / resolution) ** 2
    if math.isclose(limit, round(limit), rel_tol=_ROUNDING):
        limit = round(limit)
    return {
        "n": count,
        **_statistics(metres_of(squares, resolution), 1.0),
        "share_lt_0p1": share(int((squares < limit).sum()), len(squares)),
        "share_le_0p1": share(int((squares <= limit).sum()), len(squares)),
    }


def _statistics(values: NDArray[Any], unit: float) -> Values:
    names = ("mean", "median", "p95", "max")
    if not len(values):
        return dict.fromkeys(names)
    figures = (values.mean(), *np.percentile(values, [50, 95]), values.max())
    return {name: float(figure * unit) for name, figure in zip(names, figures, strict=True)}


def metres_of(squares: NDArray[np.signedinteger], resolution: float) -> NDArray[np.float64]:
    metres = np.sqrt(squares.astype(np.float64))
    metres *= resolution
    metres[squares == unreachable(squares)] = math.inf
    return metres


def _agreement(estimate: States, truth: States) -> Values:
    pairs = truth * np.uint8(3)
    pairs += estimate
    counts = lookup.histogram(pairs)[:9].reshape(3, 3).tolist()  # Python integers do not overflow
    in_truth = [sum(row) for row in counts]
    in_estimate = [sum(column) for column in zip(*counts, strict=True)]
    tp, free = counts[OCCUPIED][OCCUPIED], counts[FREE]
    known = {"tp": tp, "tn": free[FREE], "fp": free[OCCUPIED], "fn": counts[OCCUPIED][FREE]}
    fp, fn = in_estimate[OCCUPIED] - tp, in_truth[OCCUPIED] - tp
    lattice = {"tp": tp, "tn": truth.size - tp - fp - fn, "fp": fp, "fn": fn}  # unknown: negative
    known_in_both = sum(known.values())
    return {
        "iou_occupied": share(tp, in_truth[OCCUPIED] + in_estimate[OCCUPIED] - tp),
        "iou_free": share(free[FREE], in_truth[FREE] + in_estimate[FREE] - free[FREE]),
        "precision_occupied_known_in_both": share(tp, tp + known["fp"]),
        "recall_occupied_known_in_both": share(tp, tp + known["fn"]),
        "coverage": share(known_in_both, in_truth[FREE] + in_truth[OCCUPIED]),
        "coverage_free": share(free[FREE] + free[OCCUPIED], in_truth[FREE]),
        "known_in_both": known_in_both,
        "mcc_known_in_both": _mcc(**known),
        "confusion_known_in_both": known,
        "mcc_whole_lattice": _mcc(**lattice),
        "confusion_whole_lattice": lattice,
    }


def _mcc(tp: int, tn: int, fp: int, fn: int) -> float | None:
    """Return Matthews' correlation coefficient, -1..1; None if it is undefined."""
    product = (tp + fp) * (tp + fn) * (tn + fp) * (tn + fn)
    return (tp * tn - fp * fn) / math.sqrt(product) if product else None


def share(part: int, total: int) -> float | None:
    return part / total if total else None


TOGETHER = 1 << 16  # cells of a band of rows on which a thread works
_ACROSS, ACROSS_ALONE = 1 << 16, 1 << 12  # columns of a band at most: flat maps have few rows
_LIBRARIES = 28_000_000  # scipy.ndimage and its imports
_PER_CELL, _PER_WALL = 13.5, 12
_OF_BAND, _AROUND = 90, 10
"""Bytes for each cell and each wall cell of both maps, and each cell of a band; rows around it."""
_PER_CELL_ALONE, _PER_WALL_ALONE = 7.2, 52
_OF_BAND_ALONE, _AROUND_ALONE = 60, 40  # the same for a map on its own
LEAST_ROWS_ALONE = 64  # least rows of a band; in fewer, most work would be the rows around
_PER_WALL_DRAWN = 40


def bytes_to_compare(shape: tuple[int, int], walls: int, *, is_drawn: bool = False) -> int:
    """Return about how many bytes it takes to compare a map with the truth, and to draw that."""
    per_wall = _PER_WALL_DRAWN if is_drawn else _PER_WALL
    return _bytes(shape, _PER_CELL, per_wall * walls, _OF_BAND, _AROUND, 1, _ACROSS)


def bytes_alone(shape: tuple[int, int], walls: int) -> int:
    band = _OF_BAND_ALONE, _AROUND_ALONE, LEAST_ROWS_ALONE, ACROSS_ALONE
    return _bytes(shape, _PER_CELL_ALONE, _PER_WALL_ALONE * walls, *band)


def _bytes(
    shape: tuple[int, int], per_cell: float, of_walls: int,
    of_band: int, around: int, least: int, across: int,
) -> int:  # fmt: skip
    height, width = shape
    rows = max(least, TOGETHER // (min(width, across) + around))
    workers = min(threads.thread_count(), -(-height // rows))
    band = of_band * (min(rows, height) + around) * (min(width, across) + around)
    return int(_LIBRARIES + per_cell * height * width + of_walls + workers * band)


_Floats = NDArray[np.floating[Any]]
_Moments = tuple[_Floats, _Floats, _Floats, _Floats]
"""Of the windows: both means, the mean of x * y, and that of x * x + y * y."""
_C1, _C2 = 0.01**2, 0.03**2
_UNIFORM = 7
_SIGMA, _TRUNCATE, _GAUSSIAN = 1.5, 3.5, 11


def uniform_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 7 x 7 cells."""
    # As ``skimage.metrics.structural_similarity`` by default: equal weights, sample variances, and
    # no windows beyond the map. Sums are whole numbers, rounded in the last step alone.
    # Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to
    # structural similarity", IEEE Transactions on Image Processing 13(4), 2004.
    count = _UNIFORM**2
    return _mean_similarity(first, second, _UNIFORM, _uniform_moments, count / (count - 1))


def gaussian_similarity(first: States, second: States) -> float | None:
    """Return the mean structural similarity over windows of 11 x 11 cells, weighted by a bell."""
    # As Wang et al. have it: ``skimage.metrics.structural_similarity`` with
    # ``gaussian_weights=True``, ``sigma=1.5`` and ``use_sample_covariance=False``.
    return _mean_similarity(first, second, _GAUSSIAN, _gaussian_moments, 1.0)


def _mean_similarity(
    first: States, second: States, window: int, moments_of: Callable[[States, States], _Moments],
    correction: float,
) -> float | None:  # fmt: skip
    height, width = first.shape
    rows, cols = height - window + 1, width - window + 1
    if rows < 1 or cols < 1:
        return None
    halves = np.zeros(3, dtype=np.uint8)  # of a pixel's value
    halves[[OCCUPIED, UNKNOWN, FREE]] = 0, 1, 2
    a, b = halves[first], halves[second]
    sums = np.zeros(rows)
    step = max(1, TOGETHER // (min(width, _ACROSS) + _AROUND))

    def band(part: slice) -> None:
        for first in range(0, cols, _ACROSS):
            end = min(first + _ACROSS, cols)
            under = slice(part.start, part.stop + window - 1), slice(first, end + window - 1)
            sums[part] += _similarity(moments_of(a[under], b[under]), correction).sum(axis=1)

    threads.for_rows(band, (rows, cols), step)
    return float(sums.sum() / (rows * cols))


def _similarity(moments: _Moments, correction: float) -> _Floats:
    mean_x, mean_y, mean_xy, mean_squares = moments
    product, squares = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
    covariance = (mean_xy - product) * correction
    variances = (mean_squares - squares) * correction
    result: _Floats = (2 * product + _C1) * (2 * covariance + _C2)
    result /= (squares + _C1) * (variances + _C2)
    return result


def _uniform_moments(a: States, b: States) -> _Moments:
    share_of_one, share_of_two = 0.5 / _UNIFORM**2, 0.25 / _UNIFORM**2  # values are halves
    mean_x, mean_y = (_window_sums(halves) * share_of_one for halves in (a, b))
    squares = _window_sums(a * a).astype(np.float64) + _window_sums(b * b)
    return mean_x, mean_y, _window_sums(a * b) * share_of_two, squares * share_of_two


def _window_sums(values: States) -> States:
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


@records.dataclass(frozen=True, eq=False)
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
    estimated = states_on(truth.frame, estimate, transform)
    return compare_states(estimated, states_of(truth.occupancy), truth.frame)


def states_on(frame: Frame, grid: OccupancyGrid, transform: Transform | None) -> States:
    values, inside = sampled(frame, grid.occupancy, (transform or Transform()).frame(grid.frame))
    values[~inside] = map_values.UNKNOWN
    return states_of(values)


def compare_states(estimate: States, truth: States, frame: Frame) -> Comparison:
    """Return the score of a map that is on the lattice of the true one already."""
    walls, true_walls = estimate == OCCUPIED, truth == OCCUPIED
    to_truth = distance.squared_distance(true_walls)[walls]
    to_estimate = distance.squared_distance(walls)[true_walls]
    distances = {
        "dist_est_to_truth_m": to_truth,
        "dist_truth_to_est_m": to_estimate,
        "dist_est_to_truth_where_truth_known_m": to_truth[truth[walls] != UNKNOWN],
        "dist_truth_to_est_where_est_known_m": to_estimate[estimate[true_walls] != UNKNOWN],
    }
    values = {
        "cells": list(frame.shape),
        "ssim_uniform7": uniform_similarity(truth, estimate),
        "ssim_gauss": gaussian_similarity(truth, estimate),
        **{name: _wall_distances(found, frame.resolution) for name, found in distances.items()},
        **_agreement(estimate, truth),
    }
    return Comparison(frame, estimate, truth, values, to_truth, to_estimate)


LEAST_AREA = 0.25  # square metres of free cells below which an enclosed space is a pocket
_TOGETHER = 1 << 20  # cells that numpy converts to 64 bits at once


def enclosed_areas(states: States, resolution: float) -> tuple[int, int, float]:
    """Return the numbers of enclosed areas and of smaller pockets, and the areas' square metres."""
    # Spaces are 4-connected and enclosed unless they reach the border of the map. They count if
    # they have free cells, unlike the unknown inside of a thick wall; unknown cells close nothing.
    # Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    # (arXiv:1708.02354): the number of enclosed areas. Doubled walls enclose pockets.
    from scipy.ndimage import label

    labels, count = label(states != OCCUPIED)
    cells = labels.ravel()
    is_outside = np.zeros(count + 1, dtype=np.bool_)
    is_outside[0] = True
    for border in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        for start in range(0, len(border), _TOGETHER):
            is_outside[border[start : start + _TOGETHER]] = True
    labels *= states == FREE
    free = np.zeros(count + 1, dtype=np.int64)
    for start in range(0, len(cells), _TOGETHER):
        found = np.bincount(cells[start : start + _TOGETHER])
        free[: len(found)] += found
    sizes = free[(free > 0) & ~is_outside] * resolution**2
    is_area = sizes >= LEAST_AREA * (1 - _ROUNDING)
    areas = int(np.count_nonzero(is_area))
    return areas, len(sizes) - areas, float(sizes[is_area].sum())


_SMOOTHING, _ALONE_AROUND = 1.5, 2.5
"""Standard deviations, cells, of the filters for walls and for the surroundings of a cell."""
_SENSITIVITY = 0.1  # Harris's k
_APART = 3  # cells: of two corners this close, only the stronger one counts
_LEAST_TRACE = 1e-4  # a fifteenth of that at the end of a slanted line one cell wide
_SAME = 1e-5  # relative tolerance of responses in 32 bits
_HALO = 20  # cells that a response depends on, 6 + 1 + 10, and those of cells up to 3 away


def corners_of(walls: Mask) -> Mask:
    # Harris's detector: M is the mean of g g^T around a cell, g the gradient of smoothed walls. A
    # corner is where det M - 0.1 (tr M)^2 is above 0, so that g has two directions, the weaker at
    # least an eighth of the stronger, and is the largest within 3 cells. No threshold depends on
    # the strength: a thin wall has a corner at each bend and free end, as a thick one has.
    # Harris and Stephens, "A combined corner and edge detector", 1988; Filatov, Filatov, Krinkin,
    # Chen and Molodan, "2D SLAM quality evaluation methods", 2017 (arXiv:1708.02354): the number of
    # corners, which doubled walls raise.
    found, padded = np.zeros(walls.shape, dtype=np.bool_), np.pad(walls, _HALO)
    width = walls.shape[1]
    step = max(LEAST_ROWS_ALONE, TOGETHER // (min(width, ACROSS_ALONE) + 2 * _HALO))

    def mark(rows: slice) -> None:
        for col in range(0, width, ACROSS_ALONE):
            end = min(col + ACROSS_ALONE, width)
            around = padded[rows.start : rows.stop + 2 * _HALO, col : end + 2 * _HALO]
            found[rows, col:end] = _corners_in(around)

    threads.for_rows(mark, walls.shape, step)
    return found


def _corners_in(walls: Mask) -> Mask:
    core = (slice(_HALO, -_HALO),) * 2
    inner = np.zeros(walls.shape, dtype=np.bool_)
    if not walls.any():
        return inner[core]
    response, trace = _response(walls)
    inner[core] = (response[core] > 0) & (trace[core] > _LEAST_TRACE)
    at = np.flatnonzero(inner)
    flat = response.ravel()
    strongest = flat[at]
    reach = range(-_APART, _APART + 1)
    for row, col in product(reach, reach):
        if row * row + col * col <= _APART * _APART:
            np.maximum(strongest, flat[at + (row * walls.shape[1] + col)], out=strongest)
    inner.ravel()[at] = flat[at] >= strongest * (1 - _SAME)
    return inner[core]


def _response(walls: Mask) -> tuple[_Floats, _Floats]:
    """Return Harris's response, and the trace of M."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(walls.astype(np.float32), _SMOOTHING, mode="constant")
    down, across = np.zeros_like(smooth), np.zeros_like(smooth)
    np.subtract(smooth[2:], smooth[:-2], out=down[1:-1])
    np.subtract(smooth[:, 2:], smooth[:, :-2], out=across[:, 1:-1])
    down, across = down / 2, across / 2
    products = down * across, down * down, across * across
    both, rows, cols = (gaussian_filter(p, _ALONE_AROUND, mode="constant") for p in products)
    trace = rows + cols
    return rows * cols - both * both - _SENSITIVITY * trace * trace, trace


LEAST_PIECE = 5  # cells below which a piece of wall is a speck


def score_alone(states: States, frame: Frame) -> Values:
    # Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    # (arXiv:1708.02354): shares of cells, corners and enclosed areas.
    unknown, free, occupied = lookup.histogram(states)[: OCCUPIED + 1].tolist()
    walls = states == OCCUPIED
    thick = components.thickness_of(walls)
    pieces = components.labelled(walls, corners=True)
    walls &= pieces.cells_of(pieces.sizes >= LEAST_PIECE)
    sizes = pieces.sizes[1:]
    del pieces  # which takes as much memory as what follows
    corners = components.touching_groups(corners_of(walls))[1]
    areas, pockets, square_metres = enclosed_areas(states, frame.resolution)
    return {
        "cells": list(frame.shape),
        "resolution_m": frame.resolution,
        "share_occupied": share(occupied, states.size),
        "share_free": share(free, states.size),
        "share_unknown": share(unknown, states.size),
        "share_occupied_of_known": share(occupied, occupied + free),
        "wall_cells": occupied,
        "wall_pieces": int(np.count_nonzero(sizes >= LEAST_PIECE)),
        "specks": int(np.count_nonzero(sizes < LEAST_PIECE)),
        "wall_thickness_m": _statistics(thick, frame.resolution),
        "share_one_cell_thick": share(int(np.count_nonzero(thick == 1)), len(thick)),
        "corners": int(corners.max() + 1) if len(corners) else 0,
        "enclosed_areas": areas,
        "enclosed_pockets": pockets,
        "enclosed_m2": square_metres,
    }


METRES, SHARE, COUNT, NUMBER, AREA = "m", "share", "count", "number", "m2"
_OF_DISTANCES = {
    "n": (COUNT, "wall cells measured"),
    "mean": (METRES, "mean"),
    "median": (METRES, "median"),
    "p95": (METRES, "95th percentile"),
    "max": (METRES, "farthest"),
    "share_lt_0p1": (SHARE, "less than 0.1 m"),
    "share_le_0p1": (SHARE, "at most 0.1 m"),
}
_OF_CONFUSION = {
    "tp": (COUNT, "occupied in both"),
    "tn": (COUNT, "in neither"),
    "fp": (COUNT, "in the map alone"),
    "fn": (COUNT, "in the true map alone"),
}
_OF_THICKNESS = {name: _OF_DISTANCES[name] for name in ("mean", "median", "p95")} | {
    "max": (METRES, "thickest")
}

DISTANCES: dict[str, str] = {
    "dist_est_to_truth_m": "from walls of the map to true walls",
    "dist_est_to_truth_where_truth_known_m": "... where the true map is known",
    "dist_truth_to_est_m": "from true walls to walls of the map",
    "dist_truth_to_est_where_est_known_m": "... where the map is known",
}
"""Groups of figures of distances, in the order in which they are printed."""
CONFUSIONS: dict[str, str] = {
    "confusion_known_in_both": "cells that are known in both",
    "confusion_whole_lattice": "all cells of the true map",
}

AGAINST_TRUTH: dict[str, tuple[str, str]] = {
    "coverage": (SHARE, "known area of the true map, known in the map"),
    "coverage_free": (SHARE, "free area of the true map, known in the map"),
    "known_in_both": (COUNT, "cells known in both"),
    "precision_occupied_known_in_both": (SHARE, "wall cells of the map that the true map has"),
    "recall_occupied_known_in_both": (SHARE, "wall cells of the true map that the map has"),
    "iou_occupied": (SHARE, "wall cells: in both, of those in either"),
    "iou_free": (SHARE, "free cells: in both, of those in either"),
    "mcc_known_in_both": (NUMBER, "correlation of walls (MCC), where both are known"),
    "mcc_whole_lattice": (NUMBER, "correlation of walls (MCC), all cells"),
    "ssim_uniform7": (NUMBER, "structural similarity, windows of 7 x 7"),
    "ssim_gauss": (NUMBER, "structural similarity, Gaussian windows"),
}

ALONE: dict[str, tuple[str, str]] = {
    "share_occupied": (SHARE, "occupied"),
    "share_free": (SHARE, "free"),
    "share_unknown": (SHARE, "unknown"),
    "share_occupied_of_known": (SHARE, "occupied, of the known cells"),
    "wall_cells": (COUNT, "wall cells"),
    "wall_pieces": (COUNT, "pieces of wall, of 5 cells or more"),
    "specks": (COUNT, "small components, of 4 cells or fewer"),
    "share_one_cell_thick": (SHARE, "wall cells where the wall is one cell thick"),
    "corners": (COUNT, "corners and ends of walls"),
    "enclosed_areas": (COUNT, "enclosed areas of 0.25 m2 or more"),
    "enclosed_m2": (AREA, "free area that they enclose"),
    "enclosed_pockets": (COUNT, "smaller enclosed pockets"),
}

THICKNESS = "wall_thickness_m"


def figures_named(*, with_truth: bool) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of each figure that can have a bound, by its dotted name."""
    found = dict(AGAINST_TRUTH if with_truth else ALONE)
    groups = [(DISTANCES, _OF_DISTANCES), (CONFUSIONS, _OF_CONFUSION)]
    if not with_truth:
        groups = [({THICKNESS: "thickness of walls"}, _OF_THICKNESS)]
    for titles, members in groups:
        for (group, title), (name, (unit, meaning)) in product(titles.items(), members.items()):
            found[f"{group}.{name}"] = unit, f"{title}: {meaning}"
    return found


def figure_in(values: Mapping[str, Any], name: str) -> float | None:
    found: Any = values
    for part in name.split("."):
        found = found[part]
    return None if found is None else float(found)


def figure_text(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    if unit == SHARE:
        return f"{100 * value:.1f} %"
    if unit == COUNT:
        return str(int(value))
    if unit == NUMBER:
        return f"{value:.3f}"
    return f"{map_values.decimal_text(value)} {unit}"


NOTHING_COMPARED = "the maps have no known cell in common"
_OF_OVERLAP = ("known_in_both", "coverage", "coverage_free")
Side = Literal["min", "max"]


@records.dataclass(frozen=True)
class ScoreBound:
    """Bound on a figure of a score, and the value found.

    Parameters
    ----------
    name : str
        Name of the figure; a dot leads into a group, as in ``dist_est_to_truth_m.mean``.
    side : {'min', 'max'}
        Whether the figure must be at least or at most `allowed`.
    allowed : float
        The bound, in the unit of the figure: metres, or a share of 1.
    found : float or None
        Value of the figure, if it could be measured.
    """

    name: str
    side: Side
    allowed: float
    found: float | None

    @property
    def holds(self) -> bool:
        """Whether there is a figure, and it is within the bound but for rounding."""
        if self.found is None:
            return False
        beyond = self.found - self.allowed if self.side == "max" else self.allowed - self.found
        return beyond <= _ROUNDING * abs(self.allowed)


def checked_bounds(
    minimum: Mapping[str, float], maximum: Mapping[str, float], *, with_truth: bool
) -> list[tuple[str, Side, float]]:
    found: list[tuple[str, Side, float]] = []
    bounds_by_side: dict[Side, Mapping[str, float]] = {"min": minimum, "max": maximum}
    for side, bounds in bounds_by_side.items():
        for spelling, allowed in bounds.items():
            name = _known_name(spelling, side, with_truth=with_truth)
            if not isinstance(allowed, Real) or not math.isfinite(allowed):
                rule = "must be a finite number"
                raise errors.ParameterError(rule, source=f"--{side}", place=name, got=allowed)
            found.append((name, side, float(allowed)))
    least = {name: allowed for name, side, allowed in found if side == "min"}
    for name, side, allowed in found:
        if side == "max" and allowed < least.get(name, -math.inf):
            rule = f"cannot be both at least {least[name]:g} and at most {allowed:g}"
            raise errors.ParameterError(rule, source="--min, --max", place=name)
    return found


def judged(
    bounds: list[tuple[str, Side, float]], values: Mapping[str, Any]
) -> tuple[ScoreBound, ...]:
    """Return the bounds with their figures; maps without a common known cell have none."""
    names = [name for name, *_ in bounds]
    found = [None if _is_not_compared(name, values) else figure_in(values, name) for name in names]
    return tuple(ScoreBound(*bound, value) for bound, value in zip(bounds, found, strict=True))


def _is_not_compared(name: str, values: Mapping[str, Any]) -> bool:
    return values.get("known_in_both") == 0 and name not in _OF_OVERLAP


def why_missing(name: str, values: Mapping[str, Any]) -> str:
    if name.startswith("dist_"):
        return "one of the maps has no walls to measure"
    if _is_not_compared(name, values):
        return NOTHING_COMPARED
    if name.startswith("ssim_"):
        return "the truth is smaller than a window"
    if name.startswith("coverage"):
        return "the truth has no such cells"
    return "there are no such cells"


def unit_of(name: str, *, with_truth: bool) -> str:
    unit, _ = figures_named(with_truth=with_truth)[name]
    return "" if unit in (SHARE, COUNT, NUMBER) else f" {unit}"


def _known_name(spelling: str, side: str, *, with_truth: bool) -> str:
    names = figures_named(with_truth=with_truth)
    name = errors.as_known(spelling, names)
    if name in names:
        return name
    inside = [figure for figure in names if figure.startswith(f"{name}.")]
    if inside:
        rule, hint = "contains several figures", f"choose one, such as {inside[1]}"
    elif name in figures_named(with_truth=not with_truth):
        rule = "is a figure " + ("of a map without a truth" if with_truth else "that needs a truth")
        hint = "omit --truth" if with_truth else "add --truth"
    else:
        near = errors.nearest(name, names)
        rule = "is not a figure of a score"
        hint = f"did you mean {near}?" if near else "listed by mapdeal score --json, Score.values"
    raise errors.ParameterError(rule, source=f"--{side}", got=spelling, hint=hint)


_MIDDLE = 1 / 3  # of the way from the centre to the border: still called the middle


def place_text(grid: OccupancyGrid, point_xy: tuple[float, float]) -> str:
    """Return the part of a map's known area that contains a point, and the point, in words."""
    known = np.asarray(grid.occupancy) != map_values.UNKNOWN
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    at = f"at {point_xy[0] + 0.0:.4g},{point_xy[1] + 0.0:.4g}"
    if not len(rows):
        return at
    ends = [(row, col) for row in (rows[0], rows[-1]) for col in (cols[0], cols[-1])]
    corners = grid.frame.xy_from_rowcol(ends)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = np.maximum((high - low) / 2, grid.resolution)
    x, y = (np.asarray(point_xy) - (low + high) / 2) / half
    north = "north" if y > _MIDDLE else "south" if y < -_MIDDLE else ""
    east = "east" if x > _MIDDLE else "west" if x < -_MIDDLE else ""
    part = "-".join(word for word in (north, east) if word) or "middle"
    return f"in the {part}, {at}"


NO_FAULT = "no fault found"
_LEAST = {"ghost walls": 0.05, "missing area": 0.05, "faded walls": 0.1, "noisy": 0.03, "bent": 1.0}
"""Least share that is a fault: of walls, known area, true walls, and walls; for bends a multiple of
`_LEAST_BEND`. The fault that exceeds its least share most names the verdict."""
_SAME_WALL, _SAME_WALL_CELLS = 0.15, 1.5  # distance of the same walls: metres, and least in cells
_LEAST_BEND, _LEAST_GAIN = 0.1, 0.08
"""Least bend that is a fault, metres (at least two cells), and gain in walls that then coincide."""
_MAPPED = 2.0  # cells from free space within which a map should show a wall


@records.dataclass(frozen=True)
class Fault:
    """One fault of a map; severity: multiple of the least share that is a fault."""

    kind: str
    amount: float
    unit: str
    share: float | None
    x: float
    y: float
    place: str
    severity: float

    @property
    def text(self) -> str:
        amount = map_values.decimal_text(self.amount, 3) if self.unit else f"{self.amount:.0f}"
        amount += f" {self.unit}" if self.unit else ""
        if self.share is None:
            return f"{self.kind}: by up to {amount}, most {self.place}"
        reference = {
            "missing area": "of what the other map knows",
            "faded walls": "of the other map's walls",
        }.get(self.kind, "of the map's walls")
        noun = "" if self.unit else " small components"
        share = f"{100 * self.share:.3g} % {reference}"
        return f"{self.kind}: {amount}{noun} ({share}), most of it {self.place}"


def faults_of(estimate: States, truth: States, frame: Frame) -> tuple[Fault, ...]:
    if not (estimate == OCCUPIED).any() or not (truth == OCCUPIED).any():
        return ()
    return tuple(sorted(_faults_in(estimate, truth, frame), key=lambda fault: -fault.severity))


def verdict(faults: tuple[Fault, ...]) -> str:
    return faults[0].kind if faults else NO_FAULT


def _faults_in(estimate: States, truth: States, frame: Frame) -> Iterator[Fault]:
    table = np.array([map_values.UNKNOWN, map_values.FREE, map_values.OCCUPIED], dtype=np.int8)
    cell = frame.resolution
    maps = [OccupancyGrid(table[states], cell, frame.origin) for states in (estimate, truth)]
    near = max(_SAME_WALL, _SAME_WALL_CELLS * cell)

    def fault(kind: str, cells: Mask, amount: float, unit: str, total: Mask) -> Iterator[Fault]:
        share = float(cells.sum() / max(1, total.sum()))
        if share >= _LEAST[kind]:
            place = _most_of(cells, frame)
            severity = share / _LEAST[kind]
            yield Fault(kind, amount, unit, share, *place, place_text(maps[1], place), severity)

    bend = align.bend_between(*maps)
    least = max(_LEAST_BEND, 2 * cell)
    if bend.metres >= least and bend.share_bent - bend.share >= _LEAST_GAIN:
        place = place_text(maps[1], bend.point_xy)
        yield Fault("bent", bend.metres, "m", None, *bend.point_xy, place, bend.metres / least)
        near += bend.metres
    walls, true_walls = estimate == OCCUPIED, truth == OCCUPIED
    square = int((near / cell) ** 2)
    astray = walls & (truth == FREE) & ~distance.within_distance(true_walls, square)
    specks = astray & ~components.drop_small_groups(walls, LEAST_PIECE)
    ghosts = astray & ~specks
    yield from fault("ghost walls", ghosts, float(ghosts.sum()) * cell, "m", walls)
    pieces = float(components.touching_groups(specks)[1].max() + 1) if specks.any() else 0.0
    yield from fault("noisy", specks, pieces, "", walls)
    known = (truth != UNKNOWN) & ~true_walls
    missing = known & (estimate == UNKNOWN)
    yield from fault("missing area", missing, float(missing.sum()) * cell**2, "m2", known)
    mapped = true_walls & distance.within_distance(estimate == FREE, int(_MAPPED**2))
    faded = mapped & ~distance.within_distance(walls, square)
    yield from fault("faded walls", faded, float(faded.sum()) * cell, "m", mapped)


_BLOCK = 1.0  # metres: cells in touching blocks of this side are at one place


def _most_of(cells: Mask, frame: Frame) -> tuple[float, float]:
    """Return the cell in the middle of the largest cluster of cells, metres."""
    factor = max(1, round(_BLOCK / frame.resolution))
    counts = pooled(cells, factor)
    blocks, groups = components.touching_groups(counts > 0)
    sizes = np.bincount(groups, counts[tuple(blocks.T)])
    in_part = np.zeros(counts.shape, dtype=np.bool_)
    in_part[tuple(blocks[groups == sizes.argmax()].T)] = True
    cluster = np.argwhere(cells)
    return difference.middle_xy(frame, cluster[in_part[tuple(cluster.T // factor)]])


def document_of(faults: tuple[Fault, ...]) -> list[dict[str, Any]]:
    keys = ("kind", "amount", "unit", "share", "x", "y")
    return [{key: getattr(fault, key) for key in keys} for fault in faults]


def lines_of(faults: tuple[Fault, ...]) -> Iterator[str]:
    if not faults:
        yield f"  verdict   {NO_FAULT}"
    for number, fault in enumerate(faults):
        yield f"  {'and' if number else 'verdict':<9} {fault.text}"
